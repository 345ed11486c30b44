"""QD-RL's parents: the best fronts of fitness and novelty, as many elites as offspring."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pga_me_ros.core.algorithms.qd_rl.selection import elite_novelty, pareto_parents, pareto_ranks
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.errors import ArchiveError

HIGH = (2.0, 10.0)


def archive_of(elites: int) -> GridArchive:
    archive = GridArchive((40, 40), (0.0, 0.0), HIGH, 1)
    if elites:
        rng = np.random.default_rng(1)
        archive.add(
            Solutions.of(
                fitness=rng.random(elites),
                descriptors=rng.random((elites, 2)) * HIGH,
                parameters=np.zeros((elites, 1)),
                evaluations=range(elites),
            )
        )
    return archive


def draw(generation: int) -> np.random.Generator:
    return generator(3, Purpose.QDRL_SELECTION, generation)


def test_novelty_of_elites_is_in_shares_of_the_descriptors_range():
    archive = archive_of(300)
    own = archive.descriptors[archive.filled] / HIGH
    expected = cKDTree(own).query(own, 6)[0][:, 1:].mean(axis=1)
    np.testing.assert_allclose(elite_novelty(archive, 5), expected, rtol=1e-12)


@pytest.mark.parametrize("n", [1, 4, 30, 100])
def test_parents_are_the_best_fronts_and_some_of_the_next(n):
    archive = archive_of(300)
    cells = archive.filled_cells()
    ranks = pareto_ranks(archive.fitness[cells], elite_novelty(archive, 5))
    rank_of = dict(zip(cells.tolist(), ranks.tolist(), strict=True))
    parents = pareto_parents(archive, 5, draw(1), n).tolist()
    assert len(set(parents)) == n
    assert sorted(rank_of[c] for c in parents) == sorted(ranks.tolist())[:n]


def test_each_elite_of_a_front_that_is_too_large_is_chosen_sometimes():
    archive = archive_of(300)
    cells = archive.filled_cells()
    front = cells[pareto_ranks(archive.fitness[cells], elite_novelty(archive, 5)) == 0]
    chosen = {c for t in range(200) for c in pareto_parents(archive, 5, draw(t), 2).tolist()}
    assert chosen == set(front.tolist())


def test_fewer_elites_than_offspring_are_chosen_equally_often():
    archive = archive_of(7)
    counts = Counter(pareto_parents(archive, 5, draw(1), 17).tolist())
    assert sorted(counts.values()) == [2, 2, 2, 2, 3, 3, 3]


def test_parents_are_in_random_order():
    archive = archive_of(10)
    firsts = {int(pareto_parents(archive, 5, draw(t), 10)[0]) for t in range(200)}
    assert firsts == set(archive.filled_cells().tolist())


def test_the_choice_does_not_depend_on_when_cells_were_filled():
    archive, other = archive_of(50), GridArchive((40, 40), (0.0, 0.0), HIGH, 1)
    for elite in reversed(list(archive.elites())):
        other.put(elite)
    chosen = [pareto_parents(a, 5, draw(1), 20).tolist() for a in (archive, other)]
    assert chosen[0] == chosen[1]


def test_an_empty_archive_is_an_error():
    with pytest.raises(ArchiveError, match="empty"):
        pareto_parents(archive_of(0), 5, draw(1), 4)
