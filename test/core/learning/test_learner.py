"""Learners in memory and on disk: whatever is lost on the way, the outcome has the same bits."""

from __future__ import annotations

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS, Lane, grown, learner_bits

from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.plan import TrainingOrder, training_for, training_meanwhile
from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints
from pga_me_ros.core.search import Search
from pga_me_ros.core.training.resumable_learner import ResumableLearner
from pga_me_ros.errors import PgaError, RequestError, StorageError

BRIEF = SETTINGS.replace(n_crit=10, evaluations=100)
SCHEDULES = [
    {},
    {"schedule": "alternating"},
    {"critic_start": "last_init_batch"},
    {"greedy_init": "best"},
    {"replay_size": 250},
    {"replay_size": 40},
]
BY_NAME = {"ids": lambda c: "-".join(map(str, next(iter(c.items()), ("paper",))))}


@pytest.mark.parametrize("changes", SCHEDULES, **BY_NAME)
def test_a_learner_restarted_before_every_generation_continues_bit_for_bit(changes, tmp_path):
    settings = BRIEF.replace(**changes)
    graph = GraphInSmall(settings, tmp_path)
    graph.grow(range(settings.generations), restarts=range(settings.generations))
    assert graph.archive.digest() == grown(settings).archive.digest()


@pytest.mark.parametrize("changes", SCHEDULES, **BY_NAME)
def test_a_learner_that_dies_after_its_training_continues_bit_for_bit(changes, tmp_path):
    settings = BRIEF.replace(**changes)
    graph = GraphInSmall(settings, tmp_path)
    graph.grow(range(settings.generations), late_restarts=range(1, settings.generations, 2))
    assert graph.archive.digest() == grown(settings).archive.digest()


def test_training_continues_after_a_pause_longer_than_experience_is_kept(tmp_path):
    settings = BRIEF.replace(replay_size=40)
    off = settings.replace(n_evo=settings.batch_size)
    graph = GraphInSmall(settings, tmp_path, rates={3: off, 8: settings})
    graph.grow(range(settings.generations))
    assert graph.archive.digest() == grown_with_a_pause(settings, range(3, 8))


@pytest.mark.parametrize("schedule", ["overlapped", "alternating"])
def test_later_trainings_do_not_start_from_critics_of_an_interrupted_generation(schedule, tmp_path):
    settings = BRIEF.replace(schedule=schedule)
    off = settings.replace(n_evo=settings.batch_size)
    graph = GraphInSmall(settings, tmp_path, rates={4: off, 6: settings})
    graph.grow(range(4))
    for order in (training_for(settings, settings, 4), training_meanwhile(settings, 4)):
        if order:
            graph.trained(order)
    CriticCheckpoints(tmp_path).discard_since(4)
    graph.restart_learner()
    graph.grow(range(4, settings.generations))
    assert graph.archive.digest() == grown_with_a_pause(settings, range(4, 6))


def grown_with_a_pause(settings, pause):
    """Return the digest after a whole run without gradients in some generations."""
    search, task = Search(Lane.spec, settings), Lane()
    for t in range(settings.generations):
        search.settings = settings.replace(n_evo=settings.batch_size) if t in pause else settings
        search.run_generation(task)
    return search.archive.digest()


def test_a_training_repeated_with_other_rates_starts_from_the_state_before_it(tmp_path):
    once, twice = (GraphInSmall(BRIEF, tmp_path / name) for name in ("once", "twice"))
    for graph in (once, twice):
        graph.grow(range(4))
    order = TrainingOrder.of(5, 3, BRIEF.replace(n_crit=7))
    wrong = TrainingOrder.of(5, 3, BRIEF.replace(n_crit=9))
    twice.trained(wrong)
    snapshots = [graph.trained(order) for graph in (once, twice)]
    one, other = (snapshot.parameters("greedy") for snapshot in snapshots)
    assert one.tobytes() == other.tobytes()
    assert snapshots[0].version == snapshots[1].version


def test_an_order_on_older_experience_forgets_the_newer(tmp_path):
    graph = GraphInSmall(BRIEF, tmp_path)
    graph.grow(range(4))
    newer, older = TrainingOrder.of(5, 3, BRIEF), TrainingOrder.of(5, 2, BRIEF)
    sizes = [graph.trained(order).transitions for order in (older, newer, older)]
    assert sizes[0] == sizes[2] < sizes[1]


def test_an_outcome_is_found_for_exactly_its_order(tmp_path):
    graph = GraphInSmall(BRIEF, tmp_path)
    graph.grow(range(4))
    assert graph.learner.find(TrainingOrder.of(4, 2, BRIEF)) is not None
    assert graph.learner.find(TrainingOrder.of(4, 3, BRIEF)) is None
    assert graph.learner.find(TrainingOrder.of(4, 2, BRIEF.replace(n_crit=11))) is None


def test_greedy_init_best_without_a_controller_is_refused(tmp_path):
    settings = BRIEF.replace(greedy_init="best")
    graph = GraphInSmall(settings, tmp_path)
    graph.grow(range(2))
    with pytest.raises(RequestError, match="controller to start at"):
        graph.learner.prepare(TrainingOrder.of(2, 1, settings))


def test_missing_experience_is_reported(tmp_path):
    graph = GraphInSmall(BRIEF, tmp_path)
    graph.grow(range(4))
    with pytest.raises(StorageError, match="generation 4 is missing"):
        graph.learner.prepare(TrainingOrder.of(5, 4, BRIEF))


def test_experience_lost_on_disk_is_reported(tmp_path):
    graph = GraphInSmall(BRIEF, tmp_path)
    graph.grow(range(4))
    (tmp_path / "experience" / "experience-00000002.ckpt").unlink()
    graph.restart_learner()
    with pytest.raises(StorageError, match="generation 2 is missing"):
        graph.learner.prepare(TrainingOrder.of(5, 3, BRIEF))


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="choose another one, in a folder that can be"):
        ResumableLearner(Lane.spec, BRIEF, tmp_path / "file" / "run")


def test_training_without_experience_is_refused():
    with pytest.raises(PgaError, match="replay buffer is empty"):
        CriticLearner(Lane.spec, BRIEF).train(BRIEF, 2)


def test_state_carries_over_everything_but_the_experience():
    search = grown(BRIEF, generations=4)
    other = CriticLearner(Lane.spec, BRIEF)
    other.load_state(search.learner.state(), search.learner.version)
    assert learner_bits(other.state()) == learner_bits(search.learner.state())
    assert other.version == search.learner.version


@pytest.mark.parametrize(("batches", "sets"), [("shared", 1), ("own", 10)])
def test_snapshot_holds_the_state_batches_of_the_setting(batches, sets, tmp_path):
    settings = BRIEF.replace(pg_batches=batches)
    graph = GraphInSmall(settings, tmp_path)
    graph.grow(range(2))
    states = graph.trained(TrainingOrder.of(2, 1, settings)).states
    assert states.shape == (sets, settings.n_grad, settings.transition_batch, 2)
    assert len(np.unique(states.reshape(sets, -1), axis=0)) == sets
