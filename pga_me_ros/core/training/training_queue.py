"""Training orders, carried out one after the other in a separate thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.training.resumable_learner import ResumableLearner, Trained
from pga_me_ros.errors import PgaError, RequestError


class TrainingQueue:
    """Trains in a separate thread, and reports each outcome when it is durable.

    An order may come during the training that it continues. It then starts as soon as that one ends, before its outcome
    is written and reported, so that no core is idle in between.

    Args:
        learner: The learner. Others that use its experience must hold `lock`.
        tell: Called, from a thread, with each outcome.
        fail: Called, from a thread, with the exception of a training or of writing an outcome; all further orders are
            then refused.

    Attributes:
        lock: Held while the experience is read for a training.
        fault: Why no more orders are accepted; empty while they are.
    """

    def __init__(
        self,
        learner: ResumableLearner,
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
        self._writer = ThreadPoolExecutor(1)  # one after the other, as each replaces older ones

    def __len__(self) -> int:
        """Return the number of trainings that are running or wait for the one before."""
        return (self._under_way is not None) + (self._next is not None)

    def order(
        self, order: TrainingOrder, after: int = 0, greedy: Float32Array | None = None
    ) -> Snapshot | None:
        """Start a training, or queue it behind the current one.

        Args:
            order: The training.
            after: Generation whose training it must continue; 0 for the newest one before it.
            greedy: (P,) float32 start of the greedy controller, if this is the first training of the run.

        Returns:
            Its outcome if it was done before; otherwise None, and `tell` is called with the outcome later.

        Raises:
            RequestError: An earlier training failed, another is running, or the one to continue was not done here.
            StorageError: A stored file is damaged or missing.
        """
        with self.lock:
            if self.fault:
                raise RequestError(self.fault)
            if order in (self._under_way, self._next, *self._unwritten):
                return None
            # Even during another training: a restarted node requests the snapshot it missed.
            done = self._learner.find(order)
            if done is None:
                self._accept(order, after, greedy)
            return done

    def _accept(self, order: TrainingOrder, after: int, greedy: Float32Array | None) -> None:
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
                f"Training for generation {order.generation} continues that for {after}, but the newest done here "
                f"is {'none' if before is None else f'for {before}'}; order that for {after} first."
            )
        self._learner.prepare(order, greedy)
        self._under_way = order
        threading.Thread(target=self._work, args=(order,), name="training", daemon=True).start()

    def _work(self, order: TrainingOrder | None) -> None:
        """Train until no order is left; torch lets other threads run meanwhile."""
        try:
            while order is not None:
                order = self._over(self._learner.train(order))
        except (
            Exception
        ) as error:  # otherwise, the orchestrator would order the same training forever
            self._end(error)

    def _over(self, trained: Trained) -> TrainingOrder | None:
        """Start writing an outcome, and prepare and return the order queued behind it."""
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
                self._under_way = None  # repeating the order will report what is wrong
            return self._under_way

    def _write(self, trained: Trained) -> None:
        """Make an outcome durable, then report it."""
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
        """Accept no more orders."""
        with self.lock:
            self.fault = str(error) if isinstance(error, PgaError) else repr(error)
            self._under_way = self._next = None
        self._fail(error)
