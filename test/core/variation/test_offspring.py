"""Offspring depend on their generation, place and parents, not on the call that makes them."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.variation.genetic import ga_offspring
from pga_me_ros.core.variation.policy_gradient import pg_states
from pga_me_ros.core.variation.random_controllers import random_controllers
from pga_me_ros.errors import RequestError

SETTINGS = Settings(seed=5, batch_size=6, n_evo=3)
SHAPE = MlpShape((3, 8, 2))
PARENTS = np.random.default_rng(0).random((6, 2, SHAPE.parameter_count), np.float32)


def snapshot(sets):
    states = np.arange(sets * 2 * 4 * 3, dtype=np.float32).reshape(sets, 2, 4, 3)
    return Snapshot(7, 300, {}, states, 10, 0.0, 0.0)


def test_random_controllers_made_in_pieces_are_the_same():
    whole = random_controllers(SETTINGS, SHAPE, 2, 0, 6)
    pieces = [random_controllers(SETTINGS, SHAPE, 2, first, 2) for first in (4, 0, 2)]
    np.testing.assert_array_equal(np.concatenate([pieces[1], pieces[2], pieces[0]]), whole)


def test_ga_offspring_made_in_pieces_are_the_same():
    whole = ga_offspring(SETTINGS, SHAPE, 2, 1, PARENTS)
    pieces = [ga_offspring(SETTINGS, SHAPE, 2, 1 + i, PARENTS[i : i + 3]) for i in (0, 3)]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_all_random_controllers_differ():
    made = np.concatenate([random_controllers(SETTINGS, SHAPE, t, 0, 6) for t in range(3)])
    assert len(np.unique(made, axis=0)) == 18


def test_all_ga_offspring_of_one_pair_differ():
    pair = np.repeat(PARENTS[:1], 6, axis=0)
    made = np.concatenate([ga_offspring(SETTINGS, SHAPE, t, 1, pair) for t in range(3)])
    assert len(np.unique(made, axis=0)) == 18


def test_shared_states_are_for_any_place():
    for first, count in ((0, 1), (5, 3)):
        np.testing.assert_array_equal(pg_states(snapshot(1), first, count), snapshot(1).states[0])


def test_own_states_are_for_their_places():
    np.testing.assert_array_equal(pg_states(snapshot(6), 2, 3), snapshot(6).states[2:5])


def test_places_without_states_are_refused():
    with pytest.raises(RequestError, match=r"Places 4 to 6 were requested, .* states for 6 places"):
        pg_states(snapshot(6), 4, 3)
