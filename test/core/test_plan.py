"""Which operators make a generation's offspring, and when the critics train on what."""

from __future__ import annotations

import numpy as np
import pytest
from lane_task import SETTINGS, grown

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.evaluation import evaluation_ids, evaluation_rng
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.plan import GenerationPlan, batch_lines, training_for, training_meanwhile
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.errors import ArchiveError

RANDOM, GA, PG, GREEDY = Operator.RANDOM, Operator.GA, Operator.PG, Operator.GREEDY
SMALL = Settings(random_init=20, batch_size=10, n_evo=5)


def plan(generation: int = 5, **changes: object) -> list[tuple[Operator, int, int]]:
    settings = Settings(**changes)  # type: ignore[arg-type]
    slots = algorithm_of(settings).batch_plan(settings, generation)
    return [(s.operator, s.first, s.count) for s in slots]


def sample_parents(archive, seed, *places):
    settings = Settings(seed=seed)
    return algorithm_of(settings).choose_parents(archive, settings, *places)


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


def test_a_training_meanwhile_has_the_rates_of_the_generation_during_which_it_runs():
    order = training_for(SMALL.replace(n_crit=7), SMALL, 4)
    assert order == training_meanwhile(SMALL, 3)


def test_critics_that_were_off_train_at_once_on_all_experience():
    now = SMALL.replace(n_crit=7)
    order = training_for(now, SMALL.replace(n_evo=10), 4)
    assert order is not None
    assert (order.generation, order.experience, order.rates["n_crit"]) == (4, 3, 7)


def test_a_running_training_is_waited_for_even_if_gradients_are_switched_off():
    assert training_for(SMALL.replace(n_evo=10), SMALL, 4) == training_meanwhile(SMALL, 3)


def test_no_training_is_waited_for_when_gradients_were_off_before():
    off = SMALL.replace(n_evo=10)
    assert training_for(off, off, 4) is None


@pytest.mark.parametrize(
    ("generation", "within"), [(0, True), (1, True), (2, False), (8, False), (9, True)]
)
def test_the_first_and_the_last_training_end_within_their_generation(generation, within):
    settings = SMALL.replace(evaluations=100)
    plan = GenerationPlan.of(settings, settings, generation)
    assert plan.meanwhile_ends_within == within


def test_an_order_has_every_rate():
    order = training_meanwhile(SMALL, 3)
    assert order is not None
    assert sorted(order.rates) == sorted(RATES)


def test_evaluation_ids_are_consecutive():
    assert [k for t in range(3) for k in evaluation_ids(SMALL, t)] == list(range(30))


@pytest.mark.parametrize(("seed", "evaluation"), [(1, 0), (0, 1)])
def test_initial_poses_differ_by_seed_and_evaluation(seed, evaluation):
    assert evaluation_rng(0, 0).random() != evaluation_rng(seed, evaluation).random()


def test_the_division_of_a_batch_does_not_change_its_parents():
    archive = grown(SETTINGS, generations=1).archive
    whole = sample_parents(archive, 1, 4, 0, 10, 2)
    pieces = [sample_parents(archive, 1, 4, first, 5, 2) for first in (0, 5)]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_parents_are_drawn_uniformly_from_filled_cells():
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


@pytest.mark.parametrize(
    ("settings", "imported", "line"),
    [
        (
            Settings(),
            0,
            "PGA-MAP-Elites: 500 random controllers first, then batches of 1 greedy controller, 50 GA, 49 PG",
        ),
        (
            Settings(algorithm="map_elites", batch_size=50),
            20,
            "MAP-Elites: 20 imported, 480 random controllers first, then batches of 50 GA",
        ),
        (
            Settings(algorithm="td3"),
            0,
            "TD3: 500 random controllers first, then batches of 10 greedy controller",
        ),
        (
            Settings(algorithm="map_elites_es", es_samples=20),
            0,
            "MAP-Elites-ES: 1 random controllers first, then batches of 1 greedy controller, 20 ES sample",
        ),
    ],
)
def test_a_run_says_which_operators_make_its_batches(
    settings: Settings, imported: int, line: str
) -> None:
    assert batch_lines(settings, imported) == [line]


def test_a_run_warns_if_its_critics_make_no_offspring() -> None:
    lines = batch_lines(Settings(batch_size=50, n_evo=50))
    assert lines[0].endswith("then batches of 50 GA")
    assert "no offspring are made by policy gradients" in lines[1]
    assert len(batch_lines(Settings(algorithm="map_elites"))) == 1
