"""Reports put runs beside each other at equal numbers of evaluations, whatever their generations are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.report.__main__ import compared
from pga_me_ros.report.compared_run import ComparedRun
from pga_me_ros.report.comparison import compare
from pga_me_ros.report.comparison_pictures import draw_archives_compared
from pga_me_ros.report.pictures import draw_curves


def compared_run(folder: Path, evaluations: Sequence[float], *, seed: int) -> ComparedRun:
    """Return a run each of whose metrics is its number of evaluations, after generations of a given length."""
    run, curve = ComparedRun.load(folder), np.array(evaluations)
    return replace(run, seed=seed, evaluations=curve, curves=dict.fromkeys(run.curves, curve))


def stored_run(folder: Path, evaluations: Sequence[int]) -> StoredRun:
    """Return a run whose QD-score is its number of evaluations, after generations of a given length."""
    run = StoredRun.load(folder)
    first = run.generations[0]
    metrics = [replace(first.metrics, evaluations=e, qd_score=float(e)) for e in evaluations]
    return replace(run, generations=tuple(replace(first, metrics=m) for m in metrics))


def test_a_thinned_repertoire_is_not_compared() -> None:
    with pytest.raises(RequestError, match=r"thinned.* give the whole run"):
        compared([Path("zoo/qd_hopper")], asked=True)


def test_a_run_that_begins_after_the_end_of_another_is_not_compared(hopper_run: Path) -> None:
    runs = [compared_run(hopper_run, [20, 30], seed=1), compared_run(hopper_run, [40, 50], seed=2)]
    with pytest.raises(RequestError, match=r"first generation of .* after 40 .* after 30: there"):
        compare(runs)


def test_a_metric_is_unknown_before_the_first_generation(hopper_run: Path) -> None:
    runs = [compared_run(hopper_run, [20, 40], seed=1), compared_run(hopper_run, [30, 60], seed=2)]
    (task,) = compare(runs).tasks
    evaluations, values = task.curve(runs[0].system, "coverage")
    assert evaluations.tolist() == [20, 30, 40]
    np.testing.assert_array_equal(values, [[20, 20, 40], [np.nan, 30, 30]])


def test_each_archive_names_the_evaluations_it_is_after(
    hopper_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    titles = []
    monkeypatch.setattr(Axes, "set_title", lambda _, words, **__: titles.append(words))
    runs = [compared_run(hopper_run, [20, 4000], seed=1), compared_run(hopper_run, [20], seed=2)]
    runs[0] = replace(runs[0], system="longer")
    draw_archives_compared(compare(runs), tmp_path)
    assert titles == [
        "longer, seed 1\nafter 4,000 evaluations",
        f"{runs[1].system}, seed 2\nafter 20 evaluations",
    ]


def test_medians_are_taken_at_equal_numbers_of_evaluations(
    hopper_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = []
    draw = Axes.plot

    def plot(axes: Axes, x: np.ndarray, y: np.ndarray, **looks: object) -> object:
        lines.append((x.tolist(), y.tolist()))
        return draw(axes, x, y, **looks)

    monkeypatch.setattr(Axes, "plot", plot)
    draw_curves([stored_run(hopper_run, [20, 30, 40]), stored_run(hopper_run, [20, 50])], tmp_path)
    assert lines[0] == ([20, 30, 40], [20, 25, 30])
