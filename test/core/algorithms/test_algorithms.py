"""The algorithms of section 4.2 on a task that each of them solves, and how they differ."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS, Lane, SteeredLane, grown, settings_of

from pga_me_ros.core.algorithms import ALGORITHMS, Slots, algorithm_of
from pga_me_ros.core.algorithms.learners import make_learner
from pga_me_ros.core.algorithms.snapshot_fit import require_fit
from pga_me_ros.core.archive.elites import NO_PARENT
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.exploration import QUIET
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.plan import TrainingOrder, training_for, training_meanwhile
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.rules import RULES
from pga_me_ros.core.variation.make_offspring import MAKERS
from pga_me_ros.errors import RequestError, SettingsError
from pga_me_ros.tasks.rollout import rollout

SETTINGS_OF = {
    "pga_map_elites": SETTINGS,
    "map_elites": settings_of("map_elites"),
    "pg_only": settings_of("pg_only"),
    "td3": settings_of("td3", batch_size=4),
    "dcrl_map_elites": settings_of("dcrl_map_elites"),
}
BRIEF = {
    name: s.replace(
        evaluations=7 * s.batch_size, **({"n_crit": 10} if RULES[name].uses("n_crit") else {})
    )
    for name, s in SETTINGS_OF.items()
}
OPTIMUM = Lane.spec.max_steps

systems = pytest.mark.parametrize("name", list(SETTINGS_OF))
others = pytest.mark.parametrize("name", [name for name in SETTINGS_OF if name != "pga_map_elites"])


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


@pytest.mark.parametrize("name", list(ALGORITHMS))
def test_an_algorithm_names_the_operators_of_its_offspring_and_no_others(name):
    algorithm, settings = ALGORITHMS[name], Settings.from_mapping({"algorithm": name})
    slots = algorithm.offspring(settings, settings.init_generations)
    assert set(algorithm.operators) == {s.operator for s in slots if s.count}
    makers = set(algorithm.operators) - {Operator.GREEDY}
    assert makers <= set(MAKERS)


@pytest.mark.parametrize("name", list(ALGORITHMS))
def test_an_algorithm_names_the_networks_of_its_snapshots_and_no_others(name):
    if name == "qd_rl":
        settings, task = settings_of(name, task="lane_task:SteeredLane", cells=8), SteeredLane
    elif name == "map_elites_es":
        own = {"algorithm": name, "batch_size": 5, "es_samples": 4}
        settings, task = Settings.from_stored({**SETTINGS.given, **own}), Lane
    else:
        settings, task = SETTINGS_OF[name], Lane
    learner = make_learner(task.spec, settings)
    search = Search(task.spec, settings)
    learner.add(
        0,
        [
            rollout(task(), MlpController(search.shape, p), evaluation_rng(1, k))
            for k, p in enumerate(search.ask().parameters)
        ],
    )
    snapshot = learner.train(settings, 1)
    require_fit(snapshot, task.spec, settings)
    networks = algorithm_of(settings).snapshot_networks(task.spec, settings)
    assert {n: shape for n, (shape, _) in snapshot.networks.items()} == networks


FOREIGN = {
    "missing": ({"critic": None}, r"it has no network 'critic'; pga_map_elites needs one"),
    "superfluous": (
        {"center": (MlpShape((2, 2)), np.zeros(6, np.float32))},
        "'center'; pga_map_elites has none",
    ),
    "other layers": (
        {"greedy": (MlpShape((2, 2)), np.zeros(6, np.float32))},
        r"layers of network 'greedy' are \[2, 2\], the run's are \[2, 16, 2\]",
    ),
}


@pytest.mark.parametrize(("change", "words"), FOREIGN.values(), ids=FOREIGN)
def test_a_snapshot_with_other_networks_than_the_runs_is_refused(change, words):
    snapshot = grown(BRIEF["pga_map_elites"], generations=4)._snapshot
    require_fit(snapshot, Lane.spec, SETTINGS)
    networks = {n: v for n, v in {**snapshot.networks, **change}.items() if v is not None}
    with pytest.raises(RequestError, match=words):
        require_fit(dataclasses.replace(snapshot, networks=networks), Lane.spec, SETTINGS)


@pytest.mark.parametrize(
    "change",
    [
        {"generation": -1},
        {"states": np.zeros((1, 0, 64, 2), np.float32)},
        {"states": np.zeros((1, 9, 63, 2), np.float32)},
    ],
    ids=["negative", "no states", "other batch"],
)
def test_a_snapshot_with_other_states_than_the_runs_is_refused(change):
    snapshot = grown(BRIEF["pga_map_elites"], generations=4)._snapshot
    with pytest.raises(RequestError, match=r"no states|the run's are"):
        require_fit(dataclasses.replace(snapshot, **change), Lane.spec, SETTINGS)


def test_map_elites_fills_its_archive_only_by_genetic_variation():
    search = grown(SETTINGS_OF["map_elites"])
    assert search.archive.coverage == search.archive.cells
    assert search.learner.version == 0
    assert {m.offspring[Operator.GA] for m in search.metrics[2:]} == {10}


def test_map_elites_equals_pga_map_elites_without_gradients():
    pga = SETTINGS.replace(n_evo=SETTINGS.batch_size)
    assert grown(SETTINGS_OF["map_elites"]).archive.digest() == grown(pga).archive.digest()


def test_pg_only_finds_the_optimum_only_with_gradients():
    search = grown(SETTINGS_OF["pg_only"], generations=10)
    assert search.archive.max_fitness > 0.995 * OPTIMUM
    offspring = np.array([m.offspring for m in search.metrics[2:]])
    assert offspring[:, [Operator.GA, Operator.PG, Operator.GREEDY]].tolist() == [[0, 9, 1]] * 8


def reward_per_step(search, actor):
    """Return the mean reward of an actor without exploration; the lane's optimum is 1, wherever it steers."""
    act = MlpController(search.shape, actor)
    episodes = [rollout(Lane(), act, evaluation_rng(1, k)) for k in range(5)]
    return np.mean(np.concatenate([e.rewards for e in episodes]))


def test_td3_finds_the_optimum():
    search = grown(SETTINGS_OF["td3"], generations=32)
    untrained = random_parameters(search.shape, generator(SETTINGS.seed, Purpose.CRITIC_INIT, 0, 2))
    assert reward_per_step(search, search.ask().parameters[0]) > 0.99
    assert reward_per_step(search, untrained) < 0.5


def test_td3_adds_only_its_actor_to_the_archive():
    search = grown(SETTINGS_OF["td3"], generations=8)
    batch = search.ask()
    assert set(batch.operators.tolist()) == {Operator.GREEDY}
    assert (batch.parameters == batch.parameters[0]).all()
    assert (batch.parents == NO_PARENT).all()
    made_by = {e.operator for e in search.archive.elites()}
    assert made_by == {Operator.RANDOM, Operator.GREEDY}


def test_td3_trains_for_one_step_per_step_of_the_robot():
    settings = BRIEF["td3"].replace(random_init=8)
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
    settings = (
        SETTINGS_OF[name].replace(batch_size=4, random_init=8)
        if name == "td3"
        else SETTINGS_OF[name]
    )
    b = settings.batch_size
    algorithm = algorithm_of(settings)
    assert algorithm.batch_plan(settings, 0, b + 1) == [Slots(Operator.IMPORTED, 0, b)]
    assert algorithm.batch_plan(settings, 1, b + 1) == [
        Slots(Operator.IMPORTED, 0, 1),
        Slots(Operator.RANDOM, 1, b - 1),
    ]
    assert algorithm.exploration(settings, settings.init_generations - 1) == QUIET


def test_only_the_name_of_an_algorithm_is_required():
    found = {name: Settings(algorithm=name) for name in ALGORITHMS}
    assert (found["td3"].batch_size, found["td3"].schedule) == (10, "alternating")
    assert found["pg_only"].n_evo == 0
    assert found["map_elites"].batch_size == 100


@systems
def test_stored_settings_are_read_back_unchanged(name):
    settings = SETTINGS_OF[name]
    assert Settings.from_stored(settings.to_dict()) == settings
    assert settings.replace(seed=9).replace(seed=settings.seed) == settings


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"algorithm": "td4"}, r"'td4' \(did you mean 'td3'\?\); expected one of: pga_map_elites,"),
        (
            {"algorithm": "map_elites", "n_evo": 20},
            "n_evo is 20, but map_elites makes all .*remove n_evo",
        ),
        (
            {"algorithm": "pg_only", "n_evo": 20},
            "n_evo is 20, but pg_only makes no .*remove n_evo",
        ),
        ({"algorithm": "td3", "n_evo": 5}, "n_evo is 5, but td3 evaluates .*remove n_evo"),
        ({"algorithm": "td3", "n_crit": 7}, "n_crit is 7, but td3 takes one .*remove n_crit"),
        ({"algorithm": "map_elites", "n_crit": 7}, "map_elites doesn't use it; remove n_crit"),
        (
            {"algorithm": "map_elites", "replay_size": 3000},
            "map_elites doesn't use it; remove replay_size",
        ),
        ({"archive": "grid", "cells": 16}, "a grid archive doesn't use it; remove cells"),
        (
            {"algorithm": "td3", "critic_start": "last_init_batch"},
            "td3 trains between generations only; remove critic_start",
        ),
        ({"batch_size": 1, "n_evo": 0}, "batch_size is 1; pga_map_elites needs at least 2"),
        ({"exploration_sigma": -0.1}, "exploration_sigma is -0.1; expected a value from 0.0"),
        (
            {"exploration_correlation": 1.0},
            "exploration_correlation is 1.0; expected a value from 0.0 to 0.999",
        ),
        ({"exploration_correlation": 0.5}, "doesn't use it; remove exploration_correlation"),
    ],
    ids=lambda x: str(x)[:40] if isinstance(x, dict) else "",
)
def test_settings_that_an_algorithm_has_no_use_for_are_refused(values, words):
    with pytest.raises(SettingsError, match=words):
        Settings.from_mapping(values)


def test_td3_may_act_for_one_episode_per_generation():
    assert grown(BRIEF["td3"].replace(batch_size=1, random_init=2), generations=4).archive.coverage
