"""Comparisons of stored runs: numbers computed by hand, p-values of published samples."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.stats import PermutationMethod, mannwhitneyu

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.storage.reevaluations import Reevaluations
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import RequestError
from pga_me_ros.experiment.plan import COPY
from pga_me_ros.report.__main__ import compared, draw_comparison, main
from pga_me_ros.report.compared_run import ComparedRun
from pga_me_ros.report.comparison import compare, compare_experiment, rank_sum_p
from pga_me_ros.report.comparison_table import comparison_table
from pga_me_ros.tasks.registry import task_spec

LUCK = 7.0
"""How much fitness the stored runs' best controllers lose on average in re-evaluations."""

BATCH = 2

EXPERIMENT = """
systems: {map_elites: {algorithm: map_elites}, pga_map_elites: {n_evo: 1}}
tasks: [qd_walker, qd_ant]
seeds: [1, 2, 3]
budget: 6
settings: {random_init: 2, batch_size: 2, cells: 16, cvt_samples: 500, controller_hidden: [2]}
"""


def stored(
    folder: Path,
    fitness: Sequence[Sequence[float]],
    *,
    task: str = "qd_walker",
    algorithm: str = "pga_map_elites",
    seed: int = 1,
    reevaluated: bool = True,
) -> Path:
    """Store a run with given fitness, one row per generation, each solution in its own cell; return its folder."""
    spec = task_spec(task)
    values = {"n_evo": 1} if algorithm == "pga_map_elites" else {}
    settings = Settings.from_mapping(
        {
            "task": task,
            "seed": seed,
            "algorithm": algorithm,
            "evaluations": 6,
            "random_init": 2,
            "batch_size": BATCH,
            "cells": 16,
            "cvt_samples": 500,
            "controller_hidden": (2,),
            **values,
        }
    )
    directory = open_run(folder, spec, settings)
    directory.lock.release()
    before: Metrics | None = None
    with Repertoire.open(directory.repertoire) as repertoire:
        archive = repertoire.load_archive()
        for generation, row in enumerate(fitness):
            first = BATCH * generation
            batch = Solutions.of(
                fitness=row,
                descriptors=archive.centroids[first : first + BATCH],
                parameters=np.zeros((BATCH, archive.parameter_count)),
                evaluations=range(first, first + BATCH),
                generation=generation,
            )
            added = archive.add(batch)
            before = generation_metrics(archive, batch, added, generation, before)
            elites = [archive.elite(cell) for cell in added.changed_cells.tolist()]
            repertoire.commit(generation, elites, before, {n: getattr(settings, n) for n in RATES})
        bests = repertoire.bests()
    if reevaluated:
        again(bests, directory.run_id, archive.dimensions).save(directory.repertoire)
    return folder


def again(bests: list, run_id: str, dimensions: int) -> Reevaluations:
    """Return ten re-evaluations of each elite, with a spread, which are `LUCK` worse on average."""
    ids = np.repeat([best.evaluation for best in bests], 10).astype(np.int64)
    spread = np.tile(np.linspace(-1, 1, 10), len(bests))
    count = len(ids)
    return Reevaluations(
        run_id=run_id,
        evaluation=ids,
        repeat=np.tile(np.arange(10), len(bests)).astype(np.int64),
        fitness=np.repeat([best.fitness for best in bests], 10) - LUCK + spread,
        descriptor=np.zeros((count, dimensions)),
        steps=np.ones(count, np.int64),
        terminated=np.zeros(count, np.bool_),
    )


def rows(level: float) -> Float64Array:
    return np.array([[1, 2], [3, -1], [2, 5]]) + level


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an experiment: three seeds of two systems on two tasks; some runs are unfinished."""
    folder = tmp_path_factory.mktemp("experiment")
    (folder / COPY).write_text(EXPERIMENT)
    for task in ("qd_walker", "qd_ant"):
        for algorithm, level in (("map_elites", 0.0), ("pga_map_elites", 100.0)):
            for seed in (1, 2, 3):
                if (task, algorithm, seed) != ("qd_ant", "map_elites", 3):
                    fitness = rows(level + seed)
                    cut = fitness[:2] if (task, seed) == ("qd_ant", 2) else fitness
                    path = folder / algorithm / task / f"seed{seed}"
                    stored(path, cut, task=task, algorithm=algorithm, seed=seed)
    return folder


def test_qd_scores_are_offset_by_the_lowest_fitness_of_all_runs_of_the_task(
    experiment: Path,
) -> None:
    walker, ant = compare_experiment(experiment).tasks
    assert (walker.task, walker.offset, walker.evaluations) == ("qd_walker", 0.0, 6.0)
    # The sum of rows(level + seed) over six cells is 12 + 6 (level + seed); the lowest of all is -1 + 0 + 1.
    assert walker.final("map_elites", "qd_score").tolist() == [18.0, 24.0, 30.0]
    assert walker.final("pga_map_elites", "qd_score").tolist() == [618.0, 624.0, 630.0]
    assert ant.final("pga_map_elites", "qd_score").tolist() == [618.0, 630.0]


def test_a_replaced_elite_can_be_the_lowest_of_all(tmp_path: Path) -> None:
    run = ComparedRun.load(stored(tmp_path / "run", rows(0.0)))
    lower = replace(run, system="other", seed=2, lowest_fitness=-50.0)
    (task,) = compare([run, lower]).tasks
    assert task.final("pga_map_elites", "qd_score").tolist() == [12.0 + 6 * 50.0]


def test_curves_have_the_metrics_of_every_generation(experiment: Path) -> None:
    walker = compare_experiment(experiment).tasks[0]
    evaluations, coverage = walker.curve("map_elites", "coverage")
    assert evaluations.tolist() == [2.0, 4.0, 6.0]
    assert coverage.tolist() == [[2.0, 4.0, 6.0]] * 3
    _, best = walker.curve("map_elites", "max_fitness")
    assert best[0].tolist() == [3.0, 4.0, 6.0]
    _, difference = walker.curve("map_elites", "fitness_difference")
    np.testing.assert_allclose(difference, LUCK)


def test_unfinished_runs_are_reported_and_not_compared(experiment: Path) -> None:
    comparison = compare_experiment(experiment)
    ant = comparison.tasks[1]
    assert [run.seed for run in ant.systems["pga_map_elites"]] == [1, 3]
    assert sorted(comparison.missing) == [
        "map_elites/qd_ant/2: 4 of 6 evaluations",
        "map_elites/qd_ant/3: not begun",
        "pga_map_elites/qd_ant/2: 4 of 6 evaluations",
    ]
    assert all(words in comparison_table(comparison) for words in comparison.missing)


def test_the_table_has_medians_and_p_values_against_the_reference(experiment: Path) -> None:
    lines = comparison_table(compare_experiment(experiment)).splitlines()
    assert lines[2:4] == [
        "| qd_walker | map_elites | 3 | 24 | 0.100 | 6 | 1.000 | 7 | 0.100 | 7 | 1.000 |",
        "| qd_walker | pga_map_elites | 3 | 624 | - | 6 | - | 107 | - | 7 | - |",
    ]


def test_longer_runs_are_compared_at_the_end_of_the_shortest(
    tmp_path: Path,
) -> None:
    longer = stored(tmp_path / "longer", rows(0.0), seed=1)
    shorter = stored(tmp_path / "shorter", rows(0.0)[:2], seed=2)
    (task,) = compare([ComparedRun.load(longer), ComparedRun.load(shorter)]).tasks
    assert task.evaluations == 4.0
    assert task.final("pga_map_elites", "coverage").tolist() == [4.0, 4.0]


def test_values_without_re_evaluations_are_unknown(tmp_path: Path) -> None:
    run = ComparedRun.load(stored(tmp_path / "run", rows(0.0), reevaluated=False))
    comparison = compare([run])
    assert len(comparison.tasks[0].final("pga_map_elites", "fitness_difference")) == 0
    assert comparison_table(comparison).splitlines()[2].endswith("| - | - |")


def test_the_pictures_are_not_empty(experiment: Path, tmp_path: Path) -> None:
    comparison = compare_experiment(experiment)
    files = draw_comparison(comparison, tmp_path)
    assert [file.name for file in files] == [
        "comparison-curves.png",
        "comparison-curves.svg",
        "comparison-qd_walker-archives.png",
        "comparison-qd_walker-archives.svg",
        "comparison-qd_ant-archives.png",
        "comparison-qd_ant-archives.svg",
    ]
    for file in files:
        if file.suffix == ".png":
            picture = imread(file)
            assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 20


def test_an_experiment_without_a_finished_run_is_reported(tmp_path: Path) -> None:
    (tmp_path / COPY).write_text(EXPERIMENT)
    with pytest.raises(
        RequestError, match=r"12 are missing, the first: map_elites/qd_walker/1: not begun"
    ):
        compare_experiment(tmp_path)


def test_a_run_cannot_be_compared_with_itself(experiment: Path) -> None:
    path = experiment / "map_elites" / "qd_walker" / "seed1"
    with pytest.raises(RequestError, match="a second run of map_elites on qd_walker with seed 1"):
        compared([path, path], asked=True)


def test_an_experiment_is_compared_alone(experiment: Path) -> None:
    path = experiment / "map_elites" / "qd_walker" / "seed1"
    with pytest.raises(RequestError, match="give it alone"):
        compared([experiment, path], asked=False)


def test_tasks_that_share_a_name_are_not_mixed(tmp_path: Path) -> None:
    run = ComparedRun.load(stored(tmp_path / "run", rows(0.0)))
    other = replace(run, seed=2, spec=replace(run.spec, max_steps=10))
    with pytest.raises(RequestError, match="different tasks that are both called qd_walker"):
        compare([run, other])


def test_the_command_compares_runs_and_writes_the_table(
    experiment: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    runs = sorted(str(path) for path in experiment.glob("*/qd_walker/seed?"))
    monkeypatch.setattr(sys, "argv", ["report", "--compare", *runs, "--out", str(tmp_path)])
    assert main() == 0
    written = (tmp_path / "comparison.md").read_text()
    printed = capsys.readouterr().out
    assert printed.startswith(written.rstrip())
    assert str(tmp_path / "comparison-curves.svg") in printed
    assert "| qd_walker | pga_map_elites | 3 | 624 |" in written


@pytest.mark.parametrize(
    ("first", "second", "p"),
    [
        # The first line of any rank-sum table: 2 of the 20 ways to divide six ranks are as extreme.
        ([1, 2, 3], [4, 5, 6], 2 / 20),
        ([1, 2, 3, 4, 5], [6, 7, 8, 9, 10], 2 / 252),
        # U = 2: 1 + 1 + 2 of the 20 ways have a U of 2 or less, and as many have 7 or more.
        ([1, 2, 5], [3, 4, 6], 8 / 20),
        # Ties, by hand: the 6 ways to divide 1, 1, 1, 2 have the sums 2, 2, 2, 3, 3, 3, all as extreme.
        ([1, 1], [1, 2], 1.0),
        # Hollander & Wolfe, Nonparametric Statistical Methods: permeability of membranes, W = 30, one-sided 0.1272.
        (
            [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46],
            [1.15, 0.88, 0.90, 0.74, 1.21],
            2 * 0.1272,
        ),
        ([5, 5], [5, 5, 5], 1.0),
    ],
)
def test_p_values_equal_those_in_tables(first: list[float], second: list[float], p: float) -> None:
    assert rank_sum_p(first, second) == pytest.approx(p, abs=5e-5)
    assert rank_sum_p(second, first) == pytest.approx(p, abs=5e-5)


@pytest.mark.parametrize("sizes", [(3, 3), (3, 5), (8, 6)])
@pytest.mark.parametrize("ties", [False, True])
def test_p_values_of_few_runs_equal_scipys(sizes: tuple[int, int], ties: bool) -> None:
    rng = np.random.default_rng(sum(sizes))
    for _ in range(5):
        values = rng.integers(0, 6, sum(sizes)) if ties else rng.permutation(sum(sizes))
        first, second = values[: sizes[0]], values[sizes[0] :]
        method = PermutationMethod(n_resamples=20_000) if ties else "exact"
        expected = mannwhitneyu(first, second, method=method).pvalue
        assert rank_sum_p(first, second) == pytest.approx(expected, rel=1e-9)


def test_p_values_of_many_runs_are_the_normal_approximation() -> None:
    first, second = np.arange(20.0), np.arange(20.0) + 20.5
    # U = 0, mean 200, variance 20 * 20 * 41 / 12; half a rank of continuity correction.
    z = (200 - 0.5) / math.sqrt(20 * 20 * 41 / 12)
    assert rank_sum_p(first, second) == pytest.approx(math.erfc(z / math.sqrt(2)), rel=1e-9)


def test_without_values_there_is_no_p_value() -> None:
    assert math.isnan(rank_sum_p([], [1.0]))
