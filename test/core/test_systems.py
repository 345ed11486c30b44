"""The systems of section 4.2 on a task that each of them solves, and what tells them apart."""

from __future__ import annotations

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS, Lane, grown

from pga_me_ros.core.elites import NO_PARENT, Operator
from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.policy import Controller, random_parameters
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.schedule import TrainingOrder, evaluation_rng, training_for, training_meanwhile
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.systems import SYSTEMS, Slots, system_of
from pga_me_ros.tasks.rollout import rollout

SYSTEM = {
    "pga_map_elites": SETTINGS,
    "map_elites": SETTINGS.replace(algorithm="map_elites", n_evo=50),
    "pg_only": SETTINGS.replace(algorithm="pg_only", n_evo=0),
    "td3": SETTINGS.replace(algorithm="td3", n_evo=50, batch_size=4),
}
BRIEF = {name: s.replace(n_crit=10, evaluations=7 * s.batch_size) for name, s in SYSTEM.items()}
OPTIMUM = Lane.spec.max_steps

systems = pytest.mark.parametrize("name", list(SYSTEM))
others = pytest.mark.parametrize("name", [name for name in SYSTEM if name != "pga_map_elites"])


@others
def test_the_same_seed_gives_the_same_bits_and_another_one_others(name):
    one, again = grown(BRIEF[name]), grown(BRIEF[name])
    assert one.archive.digest() == again.archive.digest()
    assert one.metrics == again.metrics
    assert grown(BRIEF[name].replace(seed=4)).archive.digest() != one.archive.digest()


@others
def test_a_learner_that_dies_changes_nothing(name, tmp_path):
    settings = BRIEF[name]
    graph = GraphInSmall(settings, tmp_path)
    graph.grow(range(settings.generations), restarts=(3, 6), late_restarts=(4, 5))
    assert graph.archive.digest() == grown(settings).archive.digest()


@systems
def test_every_evaluation_counts(name):
    settings = BRIEF[name]
    metrics = grown(settings).metrics
    b = settings.batch_size
    assert [m.evaluations for m in metrics] == [b * (t + 1) for t in range(len(metrics))]
    assert {sum(m.offspring) for m in metrics} == {b}


@pytest.mark.parametrize("name", list(SYSTEMS))
def test_a_variation_node_makes_what_its_system_makes_and_no_other(name):
    system, settings = SYSTEMS[name], Settings.from_mapping({"algorithm": name})
    slots = system.offspring(settings, settings.init_generations)
    made = {s.operator for s in slots if s.count}
    assert set(system.parents) == made - {Operator.GREEDY}


def test_map_elites_fills_its_archive_by_genetic_variation_alone():
    search = grown(SYSTEM["map_elites"])
    assert search.archive.coverage == search.archive.cells
    assert search.learner.version == 0
    assert {m.offspring[Operator.GA] for m in search.metrics[2:]} == {10}


def test_map_elites_is_what_the_paper_calls_an_equivalent():
    pga = SETTINGS.replace(n_evo=SETTINGS.batch_size)
    assert grown(SYSTEM["map_elites"]).archive.digest() == grown(pga).archive.digest()


def test_pg_only_finds_the_optimum_with_gradients_alone():
    search = grown(SYSTEM["pg_only"], generations=10)
    assert search.archive.max_fitness > 0.995 * OPTIMUM
    offspring = np.array([m.offspring for m in search.metrics[2:]])
    assert offspring[:, [Operator.GA, Operator.PG, Operator.GREEDY]].tolist() == [[0, 9, 1]] * 8


def reward_per_step(search, actor):
    """Return the mean reward of an actor that no longer explores; the lane's optimum is 1, wherever it steers."""
    act = Controller(search.shape, actor)
    episodes = [rollout(Lane(), act, evaluation_rng(1, k)) for k in range(5)]
    return np.mean(np.concatenate([e.rewards for e in episodes]))


def test_td3_finds_the_optimum():
    search = grown(SYSTEM["td3"], generations=32)
    untrained = random_parameters(search.shape, generator(SETTINGS.seed, Purpose.CRITIC_INIT, 0, 2))
    assert reward_per_step(search, search.ask().parameters[0]) > 0.99
    assert reward_per_step(search, untrained) < 0.5


def test_td3_offers_its_actor_and_nothing_else():
    search = grown(SYSTEM["td3"], generations=8)
    batch = search.ask()
    assert set(batch.operators.tolist()) == {Operator.GREEDY}
    assert (batch.parameters == batch.parameters[0]).all()
    assert (batch.parents == NO_PARENT).all()
    made_by = {e.operator for e in search.archive.elites()}
    assert made_by == {Operator.RANDOM, Operator.GREEDY}


def test_td3_trains_for_one_step_per_step_of_the_robot():
    settings = BRIEF["td3"].replace(random_init=8, n_crit=7)
    search, task = Search(Lane.spec, settings), Lane()
    for t in range(5):
        before = search.learner.version
        search.ask()
        trained = search.learner.version - before
        assert trained == (search.metrics[-1].steps if t >= 2 else 0)
        search.run_generation(task)


def test_td3_trains_on_all_experience_before_each_generation():
    s = BRIEF["td3"].replace(random_init=8)
    assert [training_meanwhile(s, t) for t in range(4)] == [None] * 4
    orders = [training_for(s, s, t) for t in range(4)]
    assert orders == [None, None, TrainingOrder.of(2, 1, s), TrainingOrder.of(3, 2, s)]


@systems
def test_a_run_starts_with_given_controllers_and_then_random_ones(name):
    settings = SYSTEM[name].replace(batch_size=4, random_init=8) if name == "td3" else SYSTEM[name]
    b = settings.batch_size
    system = system_of(settings)
    assert system.batch_plan(settings, 0, b + 1) == [Slots(Operator.IMPORTED, 0, b)]
    assert system.batch_plan(settings, 1, b + 1) == [
        Slots(Operator.IMPORTED, 0, 1),
        Slots(Operator.RANDOM, 1, b - 1),
    ]
    assert system.exploration_sigma(settings, settings.init_generations - 1) == 0.0


def test_the_name_of_a_system_is_all_that_has_to_be_given():
    found = {name: Settings(algorithm=name) for name in SYSTEMS}
    assert (found["td3"].batch_size, found["td3"].schedule) == (10, "alternating")
    assert found["pg_only"].n_evo == 0
    assert found["map_elites"].batch_size == 100


@systems
def test_what_was_stored_of_settings_gives_the_same_again(name):
    settings = SYSTEM[name]
    assert Settings.from_mapping(settings.to_dict()) == settings
    assert settings.replace(seed=9).replace(seed=settings.seed) == settings


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"algorithm": "td4"}, r"'td4' \(did you mean 'td3'\?\); expected one of: pga_map_elites,"),
        (
            {"algorithm": "map_elites", "n_evo": 20},
            "n_evo is 20, but map_elites makes all 100 .*leave n_evo out",
        ),
        (
            {"algorithm": "pg_only", "n_evo": 20},
            "n_evo is 20, but pg_only makes no .*leave n_evo out",
        ),
        ({"algorithm": "td3", "n_evo": 5}, "n_evo is 5, but all episodes of td3 .*leave n_evo out"),
        (
            {"algorithm": "td3", "critic_start": "last_init_batch"},
            "td3 trains between generations only; leave critic_start out",
        ),
        ({"batch_size": 1, "n_evo": 0}, "batch_size is 1; pga_map_elites needs at least 2"),
        ({"exploration_sigma": -0.1}, "exploration_sigma is -0.1; expected a value from 0.0"),
    ],
    ids=lambda x: str(x)[:40] if isinstance(x, dict) else "",
)
def test_settings_that_a_system_has_no_room_for_are_refused(values, words):
    with pytest.raises(SettingsError, match=words):
        Settings.from_mapping(values)


def test_td3_may_act_for_one_episode_per_generation():
    assert grown(BRIEF["td3"].replace(batch_size=1, random_init=2), generations=4).archive.coverage
