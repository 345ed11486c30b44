"""The elites at which MAP-Elites-ES starts: probabilities computed by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from lane_task import Lane, grown
from scipy.spatial.distance import cdist
from test_map_elites_es import SHORT

from pga_me_ros.core.algorithms.map_elites_es.archives import SCALED, EsArchives
from pga_me_ros.core.algorithms.map_elites_es.selection import (
    exploit_probabilities,
    explore_probabilities,
    plain_probabilities,
)
from pga_me_ros.tasks.spec import TaskSpec


def test_exploit_prefers_the_best_and_the_better_recent_ones():
    fitness = np.array([9.0, 1.0, 3.0, 7.0, 4.0, 5.0, -1.0])
    changed = np.array([10, 70, 60, 20, 50, 40, 30])  # the five last: 1, 2, 4, 5, 6
    got = exploit_probabilities(fitness, changed)
    # 5.0 and 4.0 are the two best of those; relative to the lowest of all, plus 1: 7 and 6.
    np.testing.assert_allclose(got, [0.5, 0, 0, 0, 0.5 * 6 / 13, 0.5 * 7 / 13, 0])


def test_exploit_uses_the_best_if_there_are_few():
    got = exploit_probabilities(np.array([1.0, 3.0, 2.0, 3.0]), np.arange(4))
    assert got.tolist() == [0.0, 1.0, 0.0, 0.0]


def test_exploit_handles_equal_fitness():
    got = exploit_probabilities(np.full(6, -2.0), np.arange(6))
    np.testing.assert_allclose(got.sum(), 1.0)


def test_explore_prefers_the_most_novel_in_proportion():
    novelty = np.array([0.1, 0.5, 0.2, 0.3, 0.4, 0.6, 0.15])
    got = explore_probabilities(novelty)
    expected = np.where(novelty >= 0.2, novelty, 0.0) / 2.0
    np.testing.assert_allclose(got, 0.1 / 7 + 0.9 * expected)


@pytest.mark.parametrize("count", [1, 4, 9])
def test_explore_uses_any_if_nothing_is_novel(count: int):
    np.testing.assert_allclose(explore_probabilities(np.zeros(count)), np.full(count, 1 / count))


def test_plain_is_half_the_best_and_half_random():
    np.testing.assert_allclose(plain_probabilities(np.array([1.0, 5.0])), [0.25, 0.75])


def test_an_elites_novelty_excludes_itself():
    search = grown(SHORT)
    search.ask()
    state = search.learner.state()
    found = EsArchives(Lane.spec, SHORT, state["center"].size)
    found.load_state(state)
    distances = np.sort(cdist(state["elite_behaviors"], state["behaviors"]), axis=1)
    assert (distances[:, 0] == 0).all()
    np.testing.assert_allclose(found._elite_novelty(), distances[:, 1:9].mean(axis=1))


def test_starts_are_drawn_with_the_right_frequencies():
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


UNITS = np.array([1.0, 1000.0])
CELLS = SHORT.replace(cells=30, cvt_samples=500)


def two_dimensional(high: tuple[float, float]) -> TaskSpec:
    return dataclasses.replace(
        Lane.spec,
        descriptor_names=("end", "swing"),
        descriptor_low=(0.0, 0.0),
        descriptor_high=high,
        archive_bins=(4, 4),
    )


def found_in(high: tuple[float, float], state: dict[str, np.ndarray] | None = None) -> EsArchives:
    """Return archives with 60 more centers, in units that match a range, in addition to those of a state."""
    found = EsArchives(two_dimensional(high), CELLS, 1)
    if state is not None:
        found.load_state(state)
    rng = np.random.default_rng(8)
    for generation, behavior in enumerate(rng.random((60, 2)) * high):
        found.add(np.zeros(1, np.float32), float(rng.random()), behavior, generation)
    return found


def test_cells_and_novelty_do_not_depend_on_the_units_of_the_descriptor():
    plain, wide = found_in((1.0, 1.0)), found_in((1.0, 1000.0))
    np.testing.assert_array_equal(plain.state()["elite_cells"], wide.state()["elite_cells"])
    np.testing.assert_allclose(plain._elite_novelty(), wide._elite_novelty(), rtol=1e-9)
    asked = np.random.default_rng(9).random((5, 2))
    np.testing.assert_allclose(plain.novelty(asked), wide.novelty(asked * UNITS), rtol=1e-9)


def test_the_state_of_an_older_version_keeps_its_cells():
    new = found_in((1.0, 1000.0))
    fresh = EsArchives(two_dimensional((1.0, 1000.0)), CELLS, 1).state()
    old = {name: array for name, array in fresh.items() if name != SCALED}
    continued = found_in((1.0, 1000.0), old)
    assert SCALED in new.state()
    assert SCALED not in continued.state()
    assert set(continued.state()["elite_cells"]) != set(new.state()["elite_cells"])
    again = found_in((1.0, 1000.0), fresh)
    np.testing.assert_array_equal(again.state()["elite_cells"], new.state()["elite_cells"])


def test_in_the_unit_box_the_state_is_that_of_older_versions():
    assert SCALED not in found_in((1.0, 1.0)).state()
