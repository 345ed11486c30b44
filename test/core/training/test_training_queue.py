"""Trainings follow one another without a pause, with the same bits, and are announced when they are durable."""

from __future__ import annotations

import queue
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS, Lane

from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.training.resumable_learner import ResumableLearner, Trained
from pga_me_ros.core.training.training_queue import TrainingQueue
from pga_me_ros.errors import RequestError, StorageError

BRIEF = SETTINGS.replace(n_crit=10)
SOON = 60.0
"""Seconds after which an expected event counts as missing."""


def order(generation: int) -> TrainingOrder:
    """Return the training for a generation that runs while the one before is evaluated."""
    return TrainingOrder.of(generation, generation - 2, BRIEF)


class HeldLearner(ResumableLearner):
    """Trains and writes only when released."""

    def __init__(self, folder: Path) -> None:
        super().__init__(Lane.spec, BRIEF, folder)
        self.may_train = threading.Semaphore(0)
        self.may_write = threading.Semaphore(0)
        self.begun: queue.Queue[int] = queue.Queue()

    def train(self, order: TrainingOrder) -> Trained:
        self.begun.put(order.generation)
        assert self.may_train.acquire(timeout=SOON)
        return super().train(order)

    def save(self, trained: Trained) -> None:
        assert self.may_write.acquire(timeout=SOON)
        super().save(trained)

    def hold_no_more(self) -> None:
        self.may_train.release(9)
        self.may_write.release(9)


class Told:
    """Trainings in the folder of a run, and their announcements."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.learner = HeldLearner(folder)
        self._snapshots: queue.Queue[Snapshot] = queue.Queue()
        self._failures: queue.Queue[Exception] = queue.Queue()
        self.trainings = TrainingQueue(self.learner, self._snapshots.put, self._failures.put)
        self.order = self.trainings.order

    def begun(self) -> int:
        return self.learner.begun.get(timeout=SOON)

    def told(self) -> int:
        """Return the generation that is announced next; its outcome is then durable."""
        generation = self._snapshots.get(timeout=SOON).generation
        assert ResumableLearner(Lane.spec, BRIEF, self.folder).find(order(generation)) is not None
        return generation

    def nothing_told(self) -> bool:
        return self._snapshots.empty()

    def failure(self) -> Exception:
        return self._failures.get(timeout=SOON)

    def outcome(self, generation: int) -> bytes:
        return (self.folder / f"critic-{generation:08d}.ckpt").read_bytes()


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run that has experience up to generation 5 and critics for 4."""
    folder = tmp_path_factory.mktemp("stored")
    GraphInSmall(BRIEF, folder).grow(range(6))
    CriticCheckpoints(folder).discard_since(4)
    return folder


@pytest.fixture(scope="module")
def one_by_one(stored: Path, tmp_path_factory: pytest.TempPathFactory) -> Told:
    """Return outcomes for generations 5 to 7, each ordered after the announcement of the one before."""
    told = Told(shutil.copytree(stored, tmp_path_factory.mktemp("one") / "run"))
    told.learner.hold_no_more()
    for generation in (5, 6, 7):
        told.order(order(generation))
        assert told.told() == generation
    return told


@pytest.fixture
def told(stored: Path, tmp_path: Path) -> Iterator[Told]:
    told = Told(shutil.copytree(stored, tmp_path / "run"))
    yield told
    told.learner.hold_no_more()


def test_an_order_begins_when_the_training_before_is_done_but_not_yet_written(told, one_by_one):
    told.order(order(5))
    told.order(order(6), after=5)
    assert (told.begun(), len(told.trainings)) == (5, 2)
    told.learner.may_train.release()
    assert (told.begun(), len(told.trainings)) == (6, 1)
    assert told.nothing_told()
    assert told.learner.find(order(5)) is None
    told.order(order(7), after=6)
    told.learner.hold_no_more()
    assert [told.told() for _ in range(3)] == [5, 6, 7]
    for generation in (5, 6, 7):
        assert told.outcome(generation) == one_by_one.outcome(generation)


def test_an_order_repeated_during_its_training_is_done_and_announced_once(told):
    for _ in range(2):
        told.order(order(5))
        told.order(order(6), after=5)
    told.learner.may_train.release()
    assert [told.begun(), told.begun()] == [5, 6]
    assert told.order(order(5)) is None  # being written
    assert told.order(order(6), after=5) is None
    told.learner.hold_no_more()
    assert [told.told(), told.told()] == [5, 6]
    assert told.nothing_told()
    done: Any = told.order(order(6), after=5)
    assert done.generation == 6
    assert told.learner.begun.empty()


def test_an_order_whose_predecessor_was_lost_is_refused_until_the_predecessor_is_done(
    told, one_by_one
):
    with pytest.raises(RequestError, match="newest done here is for 4; order that for 5 first"):
        told.order(order(6), after=5)
    told.learner.hold_no_more()
    told.order(order(5))
    assert told.told() == 5
    told.order(order(6), after=5)
    assert told.told() == 6
    assert told.outcome(6) == one_by_one.outcome(6)


@pytest.mark.parametrize("after", [0, 4])
def test_an_order_that_does_not_continue_the_current_training_is_refused(told, after):
    told.order(order(5))
    with pytest.raises(RequestError, match="for generation 5 is under way"):
        told.order(order(6), after)
    told.order(order(6), after=5)
    with pytest.raises(RequestError, match="for generation 5 is under way"):
        told.order(order(7), after=5)


def test_no_training_follows_an_outcome_that_cannot_be_written(told):
    told.order(order(5))
    told.order(order(6), after=5)
    told.learner.may_train.release()
    assert [told.begun(), told.begun()] == [5, 6]
    shutil.rmtree(told.folder)
    told.learner.may_write.release()
    failure = told.failure()
    assert isinstance(failure, StorageError)
    told.folder.mkdir()
    told.learner.hold_no_more()
    for thread in threading.enumerate():
        if thread.name == "training":
            thread.join(SOON)
    assert told.nothing_told()
    assert not list(told.folder.iterdir())
    with pytest.raises(RequestError, match="Cannot write checkpoint"):
        told.order(order(6))


def test_an_order_that_failed_to_begin_is_refused_when_it_is_repeated(told):
    (told.folder / "experience" / "experience-00000004.ckpt").unlink()
    told.order(order(5))
    told.order(order(6), after=5)
    told.learner.hold_no_more()
    assert told.told() == 5
    with told.trainings.lock:  # held until the order behind has been dropped
        assert len(told.trainings) == 0
    with pytest.raises(StorageError, match="generation 4 is missing"):
        told.order(order(6), after=5)
