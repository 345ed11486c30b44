"""Metrics of a generation compared with values computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from operator_counts import per_operator

from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.operators import Operator


@pytest.fixture(scope="module")
def two_generations() -> list[Metrics]:
    archive = GridArchive((10,), [0.0], [1.0], 1)
    out: list[Metrics] = []
    for generation, (fitness, descriptors) in enumerate(
        [([1, 5, 2, 0], [0.05, 0.15, 0.05, 0.15]), ([9, 5, 7, 4], [0.05, 0.15, 0.95, 0.55])]
    ):
        batch = Solutions.of(
            fitness=fitness,
            descriptors=np.array(descriptors)[:, None],
            parameters=np.zeros((4, 1)),
            evaluations=range(4 * generation, 4 * generation + 4),
            operators=[Operator.GREEDY, Operator.GA, Operator.PG, Operator.PG],
            steps=[10, 20, 30, 40 + generation],
        )
        added = archive.add(batch)
        before = out[-1] if out else None
        out.append(generation_metrics(archive, batch, added, generation, before))
    return out


@pytest.mark.parametrize(
    ("name", "first", "second"),
    [
        ("generation", 0, 1),
        ("evaluations", 4, 8),
        ("coverage", 2, 4),
        ("coverage_share", 0.2, 0.4),
        ("qd_score", 7.0, 25.0),
        ("max_fitness", 5.0, 9.0),
        ("mean_fitness", 3.5, 6.25),
        ("steps", 100, 101),
        ("total_steps", 100, 201),
        ("offspring", per_operator(ga=1, pg=2, greedy=1), per_operator(ga=1, pg=2, greedy=1)),
        ("new_elites", per_operator(ga=1, greedy=1), per_operator(pg=2)),
        ("improved_elites", per_operator(pg=1), per_operator(greedy=1)),
        ("min_fitness", 2.0, 4.0),
        ("best_evaluation", 1, 4),
    ],
)
def test_metrics_equal_those_computed_by_hand(
    two_generations: list[Metrics], name: str, first: object, second: object
) -> None:
    assert [getattr(metrics, name) for metrics in two_generations] == [first, second]


def test_an_equally_fit_elite_does_not_become_the_best_one() -> None:
    archive = GridArchive((10,), [0.0], [1.0], 1)
    before: Metrics | None = None
    best = []
    for generation, (fitness, descriptor) in enumerate(
        [(5, 0.55), (5, 0.05), (6, 0.95), (1, 0.25)]
    ):
        batch = Solutions.of(
            fitness=[fitness],
            descriptors=[[descriptor]],
            parameters=np.zeros((1, 1)),
            evaluations=[generation],
        )
        before = generation_metrics(archive, batch, archive.add(batch), generation, before)
        best.append(before.best_evaluation)
    assert best == [0, 0, 2, 2]


def test_a_solution_that_may_not_enter_counts_only_as_an_evaluation() -> None:
    archive = GridArchive((10,), [0.0], [1.0], 1)
    batch = Solutions.of(
        fitness=[1, 9, 2, 9],
        descriptors=np.array([[0.05], [0.05], [0.15], [0.95]]),
        parameters=np.zeros((4, 1)),
        evaluations=range(4),
        operators=[Operator.GREEDY, Operator.GA, Operator.GREEDY, Operator.GA],
        steps=[10, 20, 30, 40],
    )
    added = archive.add(batch, batch.operators != Operator.GA)
    metrics = generation_metrics(archive, batch, added, 0, None)
    assert [e.evaluation for e in archive.elites()] == [0, 2]
    assert (metrics.evaluations, metrics.steps, metrics.qd_score) == (4, 100, 3.0)
    counts = (metrics.offspring, metrics.new_elites, metrics.improved_elites)
    assert [(c[Operator.GA], c[Operator.GREEDY]) for c in counts] == [(2, 2), (0, 2), (0, 0)]
