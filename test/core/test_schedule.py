"""Who makes which offspring, and when the critics train on what."""

from __future__ import annotations

import numpy as np
import pytest
from lane_task import SETTINGS, grown

from pga_me_ros.core.archive import CvtArchive
from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import ArchiveError
from pga_me_ros.core.schedule import (
    evaluation_ids,
    evaluation_rng,
    training_for,
    training_meanwhile,
)
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.systems import system_of

RANDOM, GA, PG, GREEDY = Operator.RANDOM, Operator.GA, Operator.PG, Operator.GREEDY
SMALL = Settings(random_init=20, batch_size=10, n_evo=5)


def plan(generation: int = 5, **changes: object) -> list[tuple[Operator, int, int]]:
    settings = Settings(**changes)  # type: ignore[arg-type]
    slots = system_of(settings).batch_plan(settings, generation)
    return [(s.operator, s.first, s.count) for s in slots]


def sample_parents(archive, seed, *places):
    settings = Settings(seed=seed)
    return system_of(settings).choose_parents(archive, settings, *places)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        pytest.param({}, [(GREEDY, 0, 1), (GA, 1, 50), (PG, 51, 49)], id="paper"),
        pytest.param(
            {"greedy_takes": "ga"}, [(GREEDY, 0, 1), (GA, 1, 49), (PG, 50, 50)], id="as-coded"
        ),
        pytest.param({"n_evo": 100}, [(GA, 0, 100)], id="map-elites"),
        pytest.param({"n_evo": 100, "greedy_takes": "ga"}, [(GA, 0, 100)], id="map-elites-ga"),
        pytest.param({"n_evo": 99}, [(GREEDY, 0, 1), (GA, 1, 99)], id="no-room-for-pg"),
        pytest.param(
            {"n_evo": 99, "greedy_takes": "ga"},
            [(GREEDY, 0, 1), (GA, 1, 98), (PG, 99, 1)],
            id="99-ga",
        ),
        pytest.param({"n_evo": 0}, [(GREEDY, 0, 1), (PG, 1, 99)], id="pg-only"),
        pytest.param(
            {"n_evo": 0, "greedy_takes": "ga"}, [(GREEDY, 0, 1), (PG, 1, 99)], id="pg-only-ga"
        ),
        pytest.param({"batch_size": 2, "n_evo": 1}, [(GREEDY, 0, 1), (GA, 1, 1)], id="two"),
        pytest.param({"batch_size": 2, "n_evo": 0}, [(GREEDY, 0, 1), (PG, 1, 1)], id="two-pg"),
    ],
)
def test_batch_plan(changes, wanted):
    generation = Settings(**changes).init_generations
    assert plan(generation, **changes) == wanted


@pytest.mark.parametrize(("random_init", "last"), [(500, 4), (401, 4), (400, 3), (1, 0)])
def test_random_controllers_come_in_whole_batches(random_init, last):
    assert plan(last, random_init=random_init) == [(RANDOM, 0, 100)]
    assert plan(last + 1, random_init=random_init)[0] == (GREEDY, 0, 1)


@pytest.mark.parametrize("b", [2, 3, 10])
@pytest.mark.parametrize("takes", ["pg", "ga"])
def test_batch_plan_covers_every_place_once(b, takes):
    for n_evo in range(b + 1):
        slots = plan(n_evo=n_evo, batch_size=b, greedy_takes=takes, random_init=1)
        places = [place for _, first, count in slots for place in range(first, first + count)]
        assert places == list(range(b))


@pytest.mark.parametrize(
    ("changes", "needed", "meanwhile"),
    [
        pytest.param(
            {},
            [None, None, (2, 1), (3, 1), (4, 2)],
            [None, None, (3, 1), (4, 2), (5, 3)],
            id="overlapped",
        ),
        pytest.param(
            {"schedule": "alternating"},
            [None, None, (2, 1), (3, 2), (4, 3)],
            [None] * 5,
            id="alternating",
        ),
        pytest.param(
            {"critic_start": "last_init_batch"},
            [None, None, (2, 0), (3, 1), (4, 2)],
            [None, (2, 0), (3, 1), (4, 2), (5, 3)],
            id="last-init-batch",
        ),
        pytest.param(
            {"critic_start": "last_init_batch", "random_init": 10},
            [None, (1, 0), (2, 0), (3, 1), (4, 2)],
            [None, (2, 0), (3, 1), (4, 2), (5, 3)],
            id="last-init-batch-is-the-first",
        ),
        pytest.param({"n_evo": 10}, [None] * 5, [None] * 5, id="map-elites"),
    ],
)
def test_trainings_of_each_generation(changes, needed, meanwhile):
    s = SMALL.replace(**changes)
    orders = [training_for(s, s, t) for t in range(5)]
    assert [(o.generation, o.experience) if o else None for o in orders] == needed
    orders = [training_meanwhile(s, t) for t in range(5)]
    assert [(o.generation, o.experience) if o else None for o in orders] == meanwhile


def test_a_training_meanwhile_has_the_rates_of_the_generation_in_which_it_ran():
    order = training_for(SMALL.replace(n_crit=7), SMALL, 4)
    assert order == training_meanwhile(SMALL, 3)


def test_critics_that_were_switched_off_train_at_once_on_all_experience():
    now = SMALL.replace(n_crit=7)
    order = training_for(now, SMALL.replace(n_evo=10), 4)
    assert order is not None
    assert (order.generation, order.experience, order.rates["n_crit"]) == (4, 3, 7)


def test_no_training_is_waited_for_when_gradients_are_switched_off():
    assert training_for(SMALL.replace(n_evo=10), SMALL, 4) is None


def test_an_order_names_every_rate():
    order = training_meanwhile(SMALL, 3)
    assert order is not None
    assert sorted(order.rates) == sorted(RATES)


def test_evaluation_ids_follow_each_other():
    assert [k for t in range(3) for k in evaluation_ids(SMALL, t)] == list(range(30))


@pytest.mark.parametrize(("seed", "evaluation"), [(1, 0), (0, 1)])
def test_initial_poses_differ_by_seed_and_evaluation(seed, evaluation):
    assert evaluation_rng(0, 0).random() != evaluation_rng(seed, evaluation).random()


def test_any_division_of_a_batch_draws_the_same_parents():
    archive = grown(SETTINGS, generations=1).archive
    whole = sample_parents(archive, 1, 4, 0, 10, 2)
    pieces = [sample_parents(archive, 1, 4, first, 5, 2) for first in (0, 5)]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_parents_are_drawn_uniformly_over_filled_cells():
    archive = grown(SETTINGS, generations=1).archive
    cells = sample_parents(archive, 1, 4, 0, 2000, 2)
    filled = archive.filled_cells()
    counts = np.array([(cells == cell).sum() for cell in filled])
    assert counts.sum() == cells.size
    expected = cells.size / len(filled)
    assert (np.abs(counts - expected) < 5 * np.sqrt(expected)).all()


def test_an_empty_archive_has_no_parents():
    archive = CvtArchive([[0.5]], [0.0], [1.0], 3)
    with pytest.raises(ArchiveError, match="empty"):
        sample_parents(archive, 1, 0, 0, 2, 1)
