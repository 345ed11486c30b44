"""QD-RL: its rewards, critics and search, on a lane whose descriptor is known at each step."""

from __future__ import annotations

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import Lane, SteeredLane, grown, learner_bits, settings_of
from operator_counts import per_operator
from scipy.spatial import cKDTree

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.algorithms.qd_rl.learner import QdRlLearner
from pga_me_ros.core.algorithms.qd_rl.selection import elite_novelty, pareto_ranks
from pga_me_ros.core.algorithms.qd_rl.state_descriptors import state_descriptors
from pga_me_ros.core.archive.elites import NO_PARENT
from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.variation.make_offspring import OffspringRequest, make_offspring
from pga_me_ros.errors import RequestError, SettingsError, StorageError, TaskError
from pga_me_ros.tasks.rollout import Episode, rollout

QD_RL = settings_of(
    "qd_rl",
    task="lane_task:SteeredLane",
    evaluations=80,
    discount=0.5,
    cells=8,
)
BRIEF = QD_RL.replace(n_crit=4, evaluations=60)
SPEC = SteeredLane.spec
SHAPE = controller_shape(SPEC, QD_RL)


@pytest.fixture(scope="module")
def whole() -> Search:
    return grown(QD_RL, task_class=SteeredLane)


def episodes(n: int, seed: int = 0) -> list[Episode]:
    rng, task = np.random.default_rng(seed), SteeredLane()
    return [
        rollout(task, MlpController(SHAPE, 3 * random_parameters(SHAPE, rng)), rng)
        for _ in range(n)
    ]


def q_values(critic: np.ndarray, inputs: np.ndarray, shape: MlpShape) -> np.ndarray:
    """Return a critic's values of states and actions."""
    *hidden, (weight, bias) = shape.layers(critic)
    for w, b in hidden:
        inputs = np.maximum(inputs @ w.T + b, 0.0)
    return (inputs @ weight.T + bias)[:, 0]


def mean_value(critic: np.ndarray, states: np.ndarray, controller: np.ndarray) -> float:
    """Return the mean value of a controller's actions in states."""
    act = MlpController(SHAPE, controller)
    inputs = np.concatenate([states, [act(s) for s in states]], axis=1)
    return float(q_values(critic, inputs, critic_shape(SPEC, QD_RL)).mean())


def test_the_archive_fills_and_the_optimum_is_reached(whole):
    best = SPEC.max_steps
    assert whole.archive.coverage == whole.archive.cells
    assert whole.archive.max_fitness > 0.99 * best
    assert whole.archive.mean_fitness > 0.9 * best
    new = np.sum([m.new_elites for m in whole.metrics], axis=0)
    assert new[list(Operator).index(Operator.DIVERSITY)] > 0


def test_same_seed_gives_the_same_bits_and_another_seed_others():
    one, same, other = (
        grown(BRIEF.replace(seed=seed), task_class=SteeredLane) for seed in (1, 1, 2)
    )
    assert one.archive.digest() == same.archive.digest() != other.archive.digest()
    assert learner_bits(one.learner.state()) == learner_bits(same.learner.state())


@pytest.mark.parametrize("changes", [{}, {"replay_size": 150}, {"state_spacing": 0.0}], ids=str)
@pytest.mark.parametrize("late", [False, True], ids=["before", "after training"])
def test_a_learner_that_dies_repeatedly_continues_bit_for_bit(changes, late, tmp_path):
    settings = BRIEF.replace(state_archive_size=20, pg_batches="own", **changes)
    graph = GraphInSmall(settings, tmp_path, task=SteeredLane)
    deaths = {"late_restarts" if late else "restarts": range(1, settings.generations)}
    graph.grow(range(settings.generations), **deaths)
    assert graph.archive.digest() == grown(settings, task_class=SteeredLane).archive.digest()


def test_a_repeated_training_starts_from_the_state_archive_before_it(tmp_path):
    settings = BRIEF.replace(state_spacing=0.01)
    once, twice = (
        GraphInSmall(settings, tmp_path / name, task=SteeredLane) for name in ("once", "twice")
    )
    snapshots = []
    for graph, rates in ((once, (7,)), (twice, (9, 7))):
        graph.grow(range(4))
        for n_crit in rates:
            trained = graph.trained(TrainingOrder.of(4, 3, settings.replace(n_crit=n_crit)))
        snapshots.append(trained)
    for name in ("diversity_critic", "critic"):
        one, other = (snapshot.parameters(name) for snapshot in snapshots)
        assert one.tobytes() == other.tobytes()


def test_half_of_a_batch_climbs_each_critic(whole):
    half = per_operator(quality=5, diversity=5)
    assert [m.offspring for m in whole.metrics[2:]] == [half] * 6
    odd = algorithm_of(QD_RL).batch_plan(QD_RL.replace(batch_size=7), 10)
    assert [(s.operator, s.first, s.count) for s in odd] == [
        (Operator.QUALITY, 0, 4),
        (Operator.DIVERSITY, 4, 3),
    ]


def test_parents_are_from_the_first_fronts(whole):
    search = grown(BRIEF, generations=5, task_class=SteeredLane)
    archive = search.archive
    cells = archive.filled_cells()
    ranks = pareto_ranks(archive.fitness[cells], elite_novelty(archive, BRIEF.novelty_neighbors))
    rank_of = dict(zip(archive.evaluations[cells].tolist(), ranks.tolist(), strict=True))
    parents = search.ask().parents
    assert (parents[:, 1] == NO_PARENT).all()
    expected = np.sort(np.resize(np.sort(ranks), BRIEF.batch_size)).tolist()
    assert sorted(rank_of[k] for k in parents[:, 0].tolist()) == expected


def test_rewards_are_the_novelty_of_state_descriptors_when_they_are_drawn():
    settings = BRIEF.replace(replay_size=300, state_spacing=0.05)
    learner = QdRlLearner(SPEC, settings)
    lived = episodes(40)
    learner.add(0, lived[:30])
    learner.train(settings, 1)
    learner.add(1, lived[30:])
    learner.train(settings, 2)
    newest = np.concatenate([state_descriptors(SPEC, e) for e in lived])[-300:].astype(float)
    known = learner.state()["state_archive"].astype(float)
    expected = cKDTree(known).query(newest, settings.novelty_neighbors)[0].mean(axis=1)
    rows = learner.diversity_transitions.rows(np.arange(300))
    np.testing.assert_allclose(rows[:, -2], expected, rtol=1e-6)
    plain = np.concatenate([e.actions for e in lived])[-300:]
    np.testing.assert_array_equal(rows[:, 3:5], plain)


def test_diversity_critics_know_what_is_novel():
    """Without discounting, the critic of diversity is novelty itself: it has to recognize novel states."""
    settings = QD_RL.replace(discount=0.0, n_crit=300, state_spacing=0.02)
    learner = QdRlLearner(SPEC, settings)
    learner.add(0, episodes(60))
    snapshot = learner.train(settings, 1)
    rows = learner.diversity_transitions.rows(np.arange(400))
    shape, critic = snapshot.network("diversity_critic")
    values = q_values(critic, rows[:, :5], shape)
    assert np.corrcoef(values, rows[:, -2])[0, 1] > 0.5


def test_offspring_climb_the_critic_of_their_half(whole):
    snapshot = whole.learner.train(QD_RL, 99)
    parents = whole.archive.parameters[whole.archive.filled_cells()]
    states = snapshot.states[0, 0]
    for operator, name in (
        (Operator.QUALITY, "critic"),
        (Operator.DIVERSITY, "diversity_critic"),
    ):
        critic = snapshot.parameters(name)
        wanted = OffspringRequest(QD_RL, SHAPE, 99, 0, len(parents), parents[:, None], snapshot)
        offspring = make_offspring(operator, wanted)
        before, after = (
            [mean_value(critic, states, p) for p in controllers]
            for controllers in (parents, offspring)
        )
        assert np.mean(after) > np.mean(before)
        assert np.greater(after, before).mean() > 0.8


def test_quality_critics_equal_those_of_a_run_without_diversity():
    lived = episodes(20)
    both, plain = QdRlLearner(SPEC, BRIEF), CriticLearner(SPEC, BRIEF)
    for learner in (both, plain):
        learner.add(0, lived)
    one, other = both.train(BRIEF, 1), plain.train(BRIEF, 1)
    critic = one.parameters("critic")
    assert critic.tobytes() == other.parameters("critic").tobytes()
    assert "diversity_critic" not in other.networks
    assert one.parameters("diversity_critic").tobytes() != critic.tobytes()


def test_state_carries_over_everything_but_the_experience():
    search = grown(BRIEF, generations=5, task_class=SteeredLane)
    other = QdRlLearner(SPEC, BRIEF)
    other.add(0, episodes(3, seed=9))
    other.load_state(search.learner.state(), search.learner.version)
    assert learner_bits(other.state()) == learner_bits(search.learner.state())
    assert other.newest == -1


@pytest.mark.parametrize(
    "damage",
    [
        lambda s: s.pop("state_archive"),
        lambda s: s.pop("state_archive_newest"),
        lambda s: s.update(state_archive=s["state_archive"].astype(np.float64)),
        lambda s: s.update(state_archive=np.zeros((3, 2), np.float32)),
        lambda s: s.pop("diversity_critics"),
        lambda s: s.pop("critics"),
    ],
)
def test_a_state_of_another_algorithm_or_task_is_refused(damage):
    state = QdRlLearner(SPEC, BRIEF).state()
    damage(state)
    with pytest.raises(StorageError, match=r"[Ss]aved critic"):
        QdRlLearner(SPEC, BRIEF).load_state(state, 0)


def test_a_task_without_state_descriptors_is_refused_before_anything_starts(tmp_path):
    settings = QD_RL.replace(task="lane_task:Lane")
    with pytest.raises(TaskError, match="'lane' has no state descriptors"):
        Search(Lane.spec, settings)
    with pytest.raises(TaskError, match="'lane' has no state descriptors"):
        open_run(tmp_path / "run", Lane.spec, settings)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"n_evo": 2}, "no offspring by genetic variation"),
        ({"critic_start": "last_init_batch"}, "between generations only"),
        ({"batch_size": 1}, "at least 2"),
    ],
)
def test_settings_that_it_does_not_use_are_refused(changes, words):
    with pytest.raises(SettingsError, match=words):
        Settings(algorithm="qd_rl", **changes)


def test_its_own_defaults_are_those_of_the_comparison():
    settings = Settings(algorithm="qd_rl")
    assert (settings.batch_size, settings.schedule) == (4, "alternating")


@pytest.mark.parametrize(("first", "count", "each"), [(0, 3, 2), (8, 3, 1)])
def test_parents_beyond_the_batch_or_in_pairs_are_refused(first, count, each, whole):
    with pytest.raises(RequestError, match="have one"):
        algorithm_of(QD_RL).choose_parents(whole.archive, QD_RL, 8, first, count, each)
