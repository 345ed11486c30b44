"""DCRL-MAP-Elites: who makes what, what is meant to achieve what, and that the actor learns to do as it is asked."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import Lane, grown, learner_bits, settings_of
from operator_counts import per_operator

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.algorithms.dcrl.learner import DcrlLearner
from pga_me_ros.core.archive.elites import NO_PARENT
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.conditioned import ConditionedActor, conditions, folded
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import ACTOR, CRITIC
from pga_me_ros.core.variation.make_offspring import OffspringRequest, make_offspring
from pga_me_ros.errors import SettingsError, StorageError, TaskError
from pga_me_ros.tasks.rollout import rollout

DCRL = settings_of("dcrl_map_elites", similarity_length=0.3)
BRIEF = DCRL.replace(n_crit=10, evaluations=70)
SPEC = Lane.spec
GA, PG, INJECTION = Operator.GA, Operator.PG, Operator.ACTOR_INJECTION


@pytest.fixture(scope="module")
def whole() -> Search:
    return grown(DCRL)


@pytest.fixture(scope="module")
def brief() -> Search:
    """A search in the middle, whose next generation is due."""
    return grown(BRIEF, generations=5)


def slots(**changes: object) -> list[tuple[Operator, int, int]]:
    settings = Settings(algorithm="dcrl_map_elites", **changes)  # type: ignore[arg-type]
    plan = algorithm_of(settings).batch_plan(settings, settings.init_generations)
    return [(s.operator, s.first, s.count) for s in plan]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        pytest.param({}, [(GA, 0, 128), (INJECTION, 128, 64), (PG, 192, 64)], id="published"),
        pytest.param(
            {"batch_size": 10}, [(GA, 0, 5), (INJECTION, 5, 2), (PG, 7, 3)], id="small batch"
        ),
        pytest.param({"injection_share": 0.0}, [(GA, 0, 128), (PG, 128, 128)], id="no injection"),
        pytest.param(
            {"injection_share": 1.0, "n_evo": 56}, [(GA, 0, 56), (INJECTION, 56, 200)], id="no PG"
        ),
        pytest.param({"n_evo": 0}, [(INJECTION, 0, 128), (PG, 128, 128)], id="no GA"),
        pytest.param({"n_evo": 256}, [(GA, 0, 256)], id="MAP-Elites"),
    ],
)
def test_shares_of_the_operators(changes, expected):
    assert slots(**changes) == expected


def test_its_own_defaults_are_those_published():
    s = Settings(algorithm="dcrl_map_elites")
    assert (s.batch_size, s.random_init, s.n_evo, s.injection_share) == (256, 256, 128, 0.5)
    assert (s.n_crit, s.transition_batch, s.target_period) == (3000, 100, 2)
    assert (s.critic_learning_rate, s.greedy_learning_rate) == (3e-4, 3e-4)
    assert (s.target_rate, s.discount, s.smoothing_sigma, s.smoothing_clip) == (
        *(0.005, 0.99, 0.2),
        0.5,
    )
    assert (s.n_grad, s.pg_learning_rate) == (150, 5e-3)
    assert (s.iso_sigma, s.line_sigma, s.similarity_length) == (0.005, 0.05, 0.1)
    assert (s.schedule, s.replay_size) == ("overlapped", 1_000_000)
    assert Settings(algorithm="dcrl_map_elites", batch_size=50).random_init == 50


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"greedy_init": "best"}, "greedy_init is 'best', but dcrl_map_elites starts its actor at"),
        ({"greedy_takes": "ga"}, "dcrl_map_elites doesn't use it; remove greedy_takes"),
        ({"exploration_sigma": 0.3}, "doesn't use it; remove exploration_sigma"),
        ({"injection_share": 1.5}, "injection_share is 1.5; expected a value from 0.0 to 1.0"),
        ({"similarity_length": 0.0}, "similarity_length is 0.0; expected a value from 1e-06"),
        ({"n_evo": 300}, "n_evo is 300, but a batch has batch_size=256 controllers"),
        ({"pg_learning_rate": -0.5}, "pg_learning_rate is -0.5; expected a value from 0.0 to 10"),
    ],
)
def test_values_that_make_no_sense_are_refused(changes, words):
    with pytest.raises(SettingsError, match=words):
        Settings(algorithm="dcrl_map_elites", **changes)


def test_other_algorithms_refuse_its_settings():
    with pytest.raises(
        SettingsError, match="pga_map_elites doesn't use it; remove injection_share"
    ):
        Settings(injection_share=0.2)


def test_the_archive_fills_and_the_optimum_is_reached(whole):
    assert whole.archive.coverage == whole.archive.cells
    assert whole.archive.max_fitness > 0.99 * SPEC.max_steps
    made = per_operator(ga=5, actor_injection=2, pg=3)
    assert [m.offspring for m in whole.metrics[2:]] == [made] * (len(whole.metrics) - 2)
    new = np.sum([np.add(m.new_elites, m.improved_elites) for m in whole.metrics], axis=0)
    assert new[list(Operator).index(INJECTION)] > 0


def test_the_actor_does_as_it_is_asked(whole):
    actor = ConditionedActor(SPEC, *whole._snapshot.network(ACTOR))
    wanted = np.linspace(0.1, 0.9, 9)
    achieved = [
        rollout(Lane(), actor.at([d]), evaluation_rng(1, k)).descriptor[0]
        for k, d in enumerate(wanted)
    ]
    assert np.corrcoef(wanted, achieved)[0, 1] > 0.7


def test_offspring_know_what_they_are_meant_to_achieve(brief):
    batch = brief.ask()
    archive = brief.archive
    descriptor_of = dict(
        zip(
            archive.evaluations[archive.filled].tolist(),
            archive.descriptors[archive.filled],
            strict=True,
        )
    )
    for place, operator in enumerate(batch.operators.tolist()):
        first, second = batch.parents[place].tolist()
        if operator == GA:
            assert np.isnan(batch.intended[place]).all()
            continue
        assert second == NO_PARENT
        np.testing.assert_array_equal(batch.intended[place], descriptor_of[first])
    assert set(batch.operators.tolist()) == {GA, INJECTION, PG}


def test_episodes_are_remembered_with_their_aims(brief):
    search, told = grown(BRIEF, generations=5), []
    search.learner.add = lambda generation, episodes: told.extend(episodes)
    batch, task = search.ask(), Lane()
    lived = [
        rollout(task, MlpController(search.shape, p), evaluation_rng(BRIEF.seed, k))
        for k, p in zip(batch.evaluations, batch.parameters, strict=True)
    ]
    search.tell(batch, lived)
    for episode, aim, operator in zip(told, batch.intended, batch.operators, strict=True):
        if operator == GA:
            assert episode.intended is None
        else:
            np.testing.assert_array_equal(episode.intended, aim)
    assert [dataclasses.replace(e, intended=None) for e in told] == lived


def test_an_injected_controller_is_the_actor_at_its_descriptor(brief):
    batch = brief.ask()
    actor = ConditionedActor(SPEC, *brief._snapshot.network(ACTOR))
    injected = batch.operators == INJECTION
    assert injected.any()
    observation = np.float32([0.3, -0.2])
    for aim, parameters in zip(batch.intended[injected], batch.parameters[injected], strict=True):
        act = MlpController(brief.shape, parameters)
        np.testing.assert_array_equal(act(observation), actor.at(aim)(observation))


@pytest.mark.parametrize("operator", [INJECTION, PG])
@pytest.mark.parametrize("pg_batches", ["shared", "own"])
def test_offspring_one_by_one_are_those_of_the_batch(operator, pg_batches):
    settings = BRIEF.replace(pg_batches=pg_batches)
    search = grown(settings, generations=4)
    search.ask()
    cells = search.archive.filled_cells()[:6]
    parents = search.archive.parameters[cells][:, None]
    aims = conditions(search.archive.descriptors[cells], SPEC)

    def made(first: int, count: int, workers: int = 1) -> np.ndarray:
        places = slice(first, first + count)
        request = OffspringRequest(
            *(settings, search.shape, 4, first, count, parents[places], search._snapshot),
            workers=workers,
            conditions=aims[places],
        )
        return make_offspring(operator, request)

    whole = made(0, 6)
    one_by_one = np.concatenate([made(i, 1) for i in range(6)])
    assert one_by_one.tobytes() == whole.tobytes() == made(0, 6, workers=3).tobytes()
    assert len(np.unique(whole, axis=0)) == 6


def test_pg_offspring_climb_the_critic_of_their_own_descriptor(whole):
    """Each gains by its own critic, and two that share a parent part ways with their descriptors."""
    snapshot = whole.learner.train(DCRL, 99)
    cells = whole.archive.filled_cells()
    parents = whole.archive.parameters[cells]
    aims = conditions(whole.archive.descriptors[cells], SPEC)
    request = OffspringRequest(
        DCRL, whole.shape, 99, 0, len(cells), parents[:, None], snapshot, conditions=aims
    )
    offspring = make_offspring(PG, request)
    shape, critics = folded(*snapshot.network(CRITIC), 2, aims)
    states = snapshot.states[0].reshape(-1, 2)

    def value(critic: np.ndarray, controller: np.ndarray) -> float:
        act = MlpController(whole.shape, controller)
        signal = np.hstack([states, [act(s) for s in states]])
        *hidden, (weights, bias) = shape.layers(critic)
        for w, b in hidden:
            signal = np.maximum(signal @ w.T + b, 0.0)
        return float((signal @ weights.T + bias).mean())

    gains = [
        value(q, after) - value(q, before)
        for q, before, after in zip(critics, parents, offspring, strict=True)
    ]
    assert np.mean(gains) > 0
    assert np.mean(np.greater(gains, 0)) > 0.8
    twins = dataclasses.replace(request, parents=np.repeat(parents[:1, None], len(cells), axis=0))
    assert len(np.unique(make_offspring(PG, twins), axis=0)) == len(cells)


def test_same_seed_gives_the_same_bits_and_another_seed_others():
    one, same, other = (grown(BRIEF.replace(seed=seed)) for seed in (1, 1, 2))
    assert one.archive.digest() == same.archive.digest() != other.archive.digest()
    assert learner_bits(one.learner.state()) == learner_bits(same.learner.state())


@pytest.mark.parametrize(
    "changes", [{}, {"replay_size": 150}, {"schedule": "alternating"}], ids=str
)
@pytest.mark.parametrize("late", [False, True], ids=["before", "after training"])
def test_a_learner_that_dies_again_and_again_goes_on_bit_for_bit(changes, late, tmp_path):
    settings = BRIEF.replace(**changes)
    graph = GraphInSmall(settings, tmp_path)
    deaths = {"late_restarts" if late else "restarts": range(1, settings.generations)}
    graph.grow(range(settings.generations), **deaths)
    assert graph.archive.digest() == grown(settings).archive.digest()


def test_aims_come_back_from_the_experience_file_bit_for_bit(brief, tmp_path):
    batch = brief.ask()
    task = Lane()
    lived = batch.with_aims(
        [
            rollout(task, MlpController(brief.shape, p), evaluation_rng(BRIEF.seed, k))
            for k, p in zip(batch.evaluations, batch.parameters, strict=True)
        ]
    )
    experience = Experience(tmp_path, BRIEF)
    for k, episode in zip(batch.evaluations, lived, strict=True):
        experience.stage(batch.generation, k, episode)
    experience.store(batch.generation)
    read = Experience(tmp_path, BRIEF).episodes(batch.generation)
    assert list(read) == lived
    assert {e.intended is None for e in read} == {True, False}


def test_a_state_of_another_algorithm_is_refused():
    other = settings_of("pga_map_elites")
    with pytest.raises(StorageError, match="Saved critic array 'critics' is float32"):
        DcrlLearner(SPEC, BRIEF).load_state(grown(other, generations=4).learner.state(), 0)


@pytest.mark.parametrize(("low", "high"), [(-math.inf, 1.0), (0.0, math.inf), (0.0, math.nan)])
def test_a_task_without_a_bounded_descriptor_is_refused(low, high):
    words = r"descriptor_low\[0\] is .* and descriptor_high\[0\] is .*expected finite numbers"
    with pytest.raises(TaskError, match=words) as error:
        Search(dataclasses.replace(SPEC, descriptor_low=(low,), descriptor_high=(high,)), DCRL)
    assert "\n" not in str(error.value)
