"""Where MAP-Elites-ES starts: probabilities counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from lane_task import Lane, grown
from scipy.spatial.distance import cdist
from test_map_elites_es import SHORT

from pga_me_ros.core.es_archives import EsArchives
from pga_me_ros.core.es_selection import (
    exploit_probabilities,
    explore_probabilities,
    plain_probabilities,
)


def test_exploit_prefers_the_best_and_the_better_of_the_recent():
    fitness = np.array([9.0, 1.0, 3.0, 7.0, 4.0, 5.0, -1.0])
    changed = np.array([10, 70, 60, 20, 50, 40, 30])  # the five last: 1, 2, 4, 5, 6
    got = exploit_probabilities(fitness, changed)
    # 5.0 and 4.0 are the two best of those; above the least of all, plus 1: 7 and 6.
    np.testing.assert_allclose(got, [0.5, 0, 0, 0, 0.5 * 6 / 13, 0.5 * 7 / 13, 0])


def test_exploit_takes_the_best_while_there_are_few():
    got = exploit_probabilities(np.array([1.0, 3.0, 2.0, 3.0]), np.arange(4))
    assert got.tolist() == [0.0, 1.0, 0.0, 0.0]


def test_exploit_copes_with_equal_fitness():
    got = exploit_probabilities(np.full(6, -2.0), np.arange(6))
    np.testing.assert_allclose(got.sum(), 1.0)


def test_explore_prefers_the_most_novel_in_proportion():
    novelty = np.array([0.1, 0.5, 0.2, 0.3, 0.4, 0.6, 0.15])
    got = explore_probabilities(novelty)
    expected = np.where(novelty >= 0.2, novelty, 0.0) / 2.0
    np.testing.assert_allclose(got, 0.1 / 7 + 0.9 * expected)


@pytest.mark.parametrize("count", [1, 4, 9])
def test_explore_takes_any_where_nothing_is_novel(count: int):
    np.testing.assert_allclose(explore_probabilities(np.zeros(count)), np.full(count, 1 / count))


def test_plain_is_half_the_best_and_half_any():
    np.testing.assert_allclose(plain_probabilities(np.array([1.0, 5.0])), [0.25, 0.75])


def test_an_elites_novelty_leaves_itself_out():
    search = grown(SHORT)
    search.ask()
    state = search.learner.state()
    found = EsArchives(Lane.spec, SHORT, state["center"].size)
    found.load_state(state)
    distances = np.sort(cdist(state["elite_behaviors"], state["behaviors"]), axis=1)
    assert (distances[:, 0] == 0).all()
    np.testing.assert_allclose(found._elite_novelty(), distances[:, 1:9].mean(axis=1))


def test_starts_are_drawn_as_often_as_they_should_be():
    search = grown(SHORT.replace(evaluations=11 * 20))
    search.ask()
    found = EsArchives(Lane.spec, SHORT, search.shape.parameter_count)
    state = search.learner.state()
    found.load_state(state)
    starts = [found.start(explore=False, generation=g) for g in range(400)]
    expected = exploit_probabilities(state["elite_fitness"], state["elite_generations"])
    counts = [sum((start == center).all() for start in starts) for center in state["elite_centers"]]
    assert sum(counts) == 400
    np.testing.assert_allclose(np.array(counts) / 400, expected, atol=0.1)
