"""The authors' published medians: read right, and drawn under one's own curves."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.algorithms import ALGORITHMS
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import metrics_to_row
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.report.__main__ import main, table
from pga_me_ros.report.paper import QUANTITIES, SYSTEMS, TASKS, paper_curve, published_at
from pga_me_ros.report.pictures import PAPER_COLOR
from pga_me_ros.tasks.registry import BUILT_IN


def test_every_built_in_task_has_the_published_curves_of_the_papers_algorithms() -> None:
    assert set(TASKS) == set(BUILT_IN)
    assert set(SYSTEMS) <= set(ALGORITHMS)
    for task in TASKS:
        for metric in QUANTITIES:
            curve = paper_curve(task, "pga_map_elites", metric)
            assert curve is not None
            assert curve.evaluations.tolist() == [1e4, 2e4, 5e4, 1e5, 2e5, 5e5, 1e6]
            assert np.isfinite(curve.median).all()


def test_values_are_those_of_the_authors_table_at_a_million() -> None:
    """Walker: coverage 1022, best 2730; Hopper: 969 and 2885."""
    for task, coverage, best in (("qd_walker", 1022, 2730), ("qd_hopper", 969, 2885)):
        at, medians = published_at(task, "pga_map_elites", 1e6)
        assert at == 1e6
        assert medians["coverage"] == coverage
        assert medians["max_fitness"] == pytest.approx(best, abs=1.0)


def test_published_is_what_was_reached_no_later_than_asked_for() -> None:
    at, medians = published_at("qd_hopper", "pga_map_elites", 99_999)
    assert at == 50_000
    assert medians["coverage"] == pytest.approx(841, abs=1.0)
    assert medians["qd_score"] == pytest.approx(1_151_254, rel=1e-5)
    assert published_at("qd_hopper", "pga_map_elites", 9_999) == (0.0, {})
    assert published_at("my_task", "pga_map_elites", 1e6) == (0.0, {})


def test_an_offset_counts_once_per_filled_cell() -> None:
    plain = paper_curve("qd_ant", "map_elites", "qd_score")
    with_offset = paper_curve("qd_ant", "map_elites", "qd_score", -277.1)
    cells = paper_curve("qd_ant", "map_elites", "coverage")
    assert plain is not None
    assert with_offset is not None
    assert cells is not None
    filled = [cells.median[cells.evaluations == at][0] for at in plain.evaluations]
    np.testing.assert_allclose(with_offset.median - plain.median, 277.1 * np.array(filled))


def test_a_curve_is_cut_where_ones_own_ends() -> None:
    whole = paper_curve("qd_hopper", "pga_map_elites", "coverage")
    assert whole is not None
    cut = whole.until(35_000)
    assert cut.evaluations.tolist() == [1e4, 2e4, 35_000]
    assert cut.median[-1] == pytest.approx((whole.median[1] + whole.median[2]) / 2)
    assert np.isnan(cut.plus_minus[-1]), "it was not read there"
    assert whole.until(50_000).evaluations.tolist() == [1e4, 2e4, 5e4]
    assert not len(whole.until(9_000).evaluations)


@pytest.fixture(scope="module")
def long_run(new_run: Callable[..., Path]) -> Path:
    """A run of 20 evaluations that claims a thousand times as many."""
    run = new_run(seed=8)
    file = run / "repertoire.db"
    with Repertoire.open(file, read_only=True) as repertoire:
        generations = repertoire.generations()
    with sqlite3.connect(file) as connection:
        connection.execute("DELETE FROM generations")
        for g in generations:
            metrics = replace(g.metrics, evaluations=1000 * g.metrics.evaluations)
            row = metrics_to_row(metrics, g.rates, g.committed, g.elites_digest)
            marks = ", ".join("?" * len(row))
            connection.execute(f"INSERT INTO generations VALUES ({marks})", row)
    connection.close()
    return run


def test_the_report_draws_them_if_asked(
    long_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    drawings = {}
    for name, more in (("with", ["--paper"]), ("without", [])):
        out = tmp_path / name
        monkeypatch.setattr(sys, "argv", ["report", str(long_run), "--out", str(out), *more])
        assert main() == 0
        drawings[name] = (out / "qd_hopper-curves.svg").read_text()
    assert PAPER_COLOR in drawings["with"]
    assert PAPER_COLOR not in drawings["without"]
    assert "| qd_hopper | pga_map_elites | authors' median | 20,000 |" in capsys.readouterr().out


def test_the_table_has_their_medians_of_each_algorithm(long_run: Path) -> None:
    run = StoredRun.load(long_run)
    last = table([run], paper=True).splitlines()[-1]
    at, medians = published_at("qd_hopper", "pga_map_elites", run.metrics[-1].evaluations)
    numbers = (at, medians["coverage"], medians["qd_score"], medians["max_fitness"])
    assert (
        last
        == "| qd_hopper | pga_map_elites | authors' median | "
        + " | ".join(f"{x:,.0f}" for x in numbers)
        + " |"
    )
    assert len(table([run]).splitlines()) == 3


def test_of_a_task_that_they_did_not_publish_it_is_said(
    new_run: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "core")
    run = new_run(task="lane_task:Lane", algorithm="map_elites", n_evo=None)
    monkeypatch.setattr(sys, "argv", ["report", str(run), "--out", str(tmp_path), "--paper"])
    assert main() == 2
    assert "error: --paper: the authors published nothing on lane" in capsys.readouterr().err
