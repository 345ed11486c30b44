"""A learner that outlives its process: its state can be restored from files, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.algorithms.learners import make_learner
from pga_me_ros.core.learning.learner import Learner
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints, CriticState
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.errors import RequestError
from pga_me_ros.tasks.spec import TaskSpec


@dataclass(frozen=True)
class Trained:
    """The outcome of a training; later trainings do not change it.

    Attributes:
        order: The training.
        snapshot: What offspring are made with.
        state: State from which the next training starts.
    """

    order: TrainingOrder
    snapshot: Snapshot
    state: CriticState


class ResumableLearner:
    """Carries out training orders, each from exactly the state it must start from.

    Whatever ran before in this process or another, the outcome of an order is the same: the state is that of the newest
    checkpoint for an earlier generation, and the replay buffer holds the experience named by the order.

    Args:
        spec: Task.
        settings: Settings of the run.
        directory: Folder of the run.
        workers: Threads of critic training.

    Raises:
        StorageError: The folder cannot be made.
        SettingsError: The device cannot be used here.
    """

    def __init__(
        self, spec: TaskSpec, settings: Settings, directory: Path, workers: int = 1
    ) -> None:
        self._spec = spec
        self._settings = settings
        self._workers = workers
        self.experience = Experience(directory / "experience", settings)
        self._checkpoints = CriticCheckpoints(directory)
        self._learner: Learner = make_learner(spec, settings, workers)
        self._trained_for: int | None = (
            None  # None: the state is not the outcome of a known training
        )

    def find(self, order: TrainingOrder) -> Snapshot | None:
        """Return the outcome of exactly this training, None if it was not done before.

        Raises:
            StorageError: Its file is damaged.
        """
        done = self._checkpoints.find(order)
        return done[0] if done else None

    def prepare(self, order: TrainingOrder, greedy: Float32Array | None = None) -> None:
        """Bring critics and replay buffer into the state from which a training starts.

        Args:
            order: The training.
            greedy: (P,) float32 start of the greedy controller if this is the first training of the run; None with
                ``greedy_init: random``.

        Raises:
            RequestError: The experience that it needs is missing, or `greedy` is needed but not given.
            NetworkError: `greedy` does not fit the layers.
            StorageError: A stored file is damaged or missing.
        """
        first = False
        if self._trained_for is None or self._trained_for >= order.generation:
            first = not self._return_to_before(order.generation)
        if first and self._settings.greedy_init == "best":
            if greedy is None:
                raise RequestError("The first training needs a controller to start at; send one.")
            self._learner.start_greedy_at(greedy)
        window = self.experience.window(order.experience)
        # Training may have been off for longer than files are kept; the buffer is then too old to continue with.
        if not window.start <= self._learner.newest + 1 <= window.stop:
            self._learner.forget_experience()
        for generation in range(max(window.start, self._learner.newest + 1), window.stop):
            self._learner.add(generation, self.experience.episodes(generation))

    def train(self, order: TrainingOrder) -> Trained:
        """Carry out the training for which `prepare` was called; it counts as done only after `save`.

        Raises:
            NetworkError: The training diverged.
        """
        self._trained_for = None
        snapshot = self._learner.train(self._settings.with_rates(order.rates), order.generation)
        self._trained_for = order.generation
        return Trained(order, snapshot, self._learner.state())

    def save(self, trained: Trained) -> None:
        """Make the outcome of a training durable; another thread may start the next training meanwhile.

        If it fails, this learner is ahead of its files and must no longer be used.

        Raises:
            StorageError: The outcome cannot be written.
        """
        self._checkpoints.save(trained.order, trained.snapshot, trained.state)

    def trained_before(self, generation: int) -> int | None:
        """Return for which generation the training was that this one would continue, None if it would be the first."""
        if self._trained_for is not None and self._trained_for < generation:
            return self._trained_for
        return self._checkpoints.newest_before(generation)

    def _return_to_before(self, generation: int) -> bool:
        """Load the newest state from before a generation's training, or start over; return whether there was one."""
        earlier = self._checkpoints.before(generation)
        if earlier:
            snapshot, state = earlier
            self._learner.load_state(state, snapshot.version)
            self._trained_for = snapshot.generation
        else:
            self._learner = make_learner(self._spec, self._settings, self._workers)
            self._trained_for = None
        return earlier is not None
