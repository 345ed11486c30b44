"""Training orders, carried out one after the other in a thread of their own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.durable_learner import DurableLearner, Trained
from pga_me_ros.core.errors import PgaError, RequestError
from pga_me_ros.core.schedule import TrainingOrder
from pga_me_ros.core.snapshot import Snapshot


class Trainings:
    """Trains in a thread of its own, and tells of each outcome once it is durable.

    An order may come while the training that it goes on from is under way. It is then begun as soon as that one is
    over, before its outcome is written and anybody has heard of it: cores need not be idle in between.

    Args:
        learner: What trains. Whoever else uses its experience holds `lock`.
        tell: Called, from a thread, with each outcome.
        fail: Called, from a thread, with what a training or the writing of an outcome raised; all further orders are
            refused then.

    Attributes:
        lock: Held while the experience is read for a training.
        fault: Why no more orders are taken, in words; empty while they are.
    """

    def __init__(
        self,
        learner: DurableLearner,
        tell: Callable[[Snapshot], None],
        fail: Callable[[Exception], None],
    ) -> None:
        self._learner = learner
        self._tell = tell
        self._fail = fail
        self.lock = threading.Lock()
        self.fault = ""
        self._under_way: TrainingOrder | None = None
        self._next: TrainingOrder | None = None
        self._unwritten: list[TrainingOrder] = []
        self._writer = ThreadPoolExecutor(1)  # one after the other, as each replaces what is older

    def __len__(self) -> int:
        """Return the number of trainings that are under way or wait for the one before."""
        return (self._under_way is not None) + (self._next is not None)

    def order(
        self, order: TrainingOrder, after: int = 0, greedy: NDArray[np.float32] | None = None
    ) -> Snapshot | None:
        """Begin a training, or have it begin after the one under way.

        Args:
            order: The training.
            after: Generation whose training it has to go on from; 0: the newest one before it.
            greedy: (P,) float32 start of the greedy controller, if this is the first training of the run.

        Returns:
            Its outcome if it was done before; else None, and it is told later.

        Raises:
            RequestError: It cannot be begun now, or what it goes on from is not there.
            StorageError: A stored file is damaged or missing.
        """
        with self.lock:
            if self.fault:
                raise RequestError(self.fault)
            if order in (self._under_way, self._next, *self._unwritten):
                return None
            # Also while another training is under way: a restarted node asks for the snapshot it missed.
            done = self._learner.find(order)
            if done is None:
                self._accept(order, after, greedy)
            return done

    def _accept(self, order: TrainingOrder, after: int, greedy: NDArray[np.float32] | None) -> None:
        if self._under_way is not None:
            if after != self._under_way.generation or self._next is not None:
                raise RequestError(
                    f"Training for generation {self._under_way.generation} is under way; wait for its snapshot."
                )
            self._next = order
            return
        before = self._learner.trained_before(order.generation)
        if after and before != after:
            raise RequestError(
                f"Training for generation {order.generation} goes on from that for {after}, but the newest done here "
                f"is {'none' if before is None else f'for {before}'}; order that for {after} first."
            )
        self._learner.prepare(order, greedy)
        self._under_way = order
        threading.Thread(target=self._work, args=(order,), name="training", daemon=True).start()

    def _work(self, order: TrainingOrder | None) -> None:
        """Train until there is no order left; torch lets other threads run meanwhile."""
        try:
            while order is not None:
                order = self._over(self._learner.train(order))
        except Exception as error:  # else the orchestrator would order the same training for ever
            self._end(error)

    def _over(self, trained: Trained) -> TrainingOrder | None:
        """Have an outcome written, and get ready for the order that waits for it, which is returned."""
        with self.lock:
            if self.fault:
                return None
            self._unwritten.append(trained.order)
            self._writer.submit(self._write, trained)
            self._under_way, self._next = self._next, None
            try:
                if self._under_way is not None:
                    self._learner.prepare(self._under_way)
            except PgaError:
                self._under_way = None  # whoever asks for it again is told what is wrong
            return self._under_way

    def _write(self, trained: Trained) -> None:
        """Make an outcome durable, then tell of it."""
        if trained.order not in self._unwritten:
            return  # the one before could not be written
        try:
            self._learner.save(trained)
        except Exception as error:
            self._unwritten.clear()
            self._end(error)
            return
        self._unwritten.remove(trained.order)
        self._tell(trained.snapshot)

    def _end(self, error: Exception) -> None:
        """Take no more orders."""
        with self.lock:
            self.fault = str(error) if isinstance(error, PgaError) else repr(error)
            self._under_way = self._next = None
        self._fail(error)
