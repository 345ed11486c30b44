"""Everything that concerns critics in one object: replay buffer, training, and the snapshot for PG variation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.learning.critic_trainer import CriticTrainer
from pga_me_ros.core.learning.replay_buffer import ReplayBuffer
from pga_me_ros.core.networks.shapes import RobotDimensions
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import CRITIC, GREEDY, Snapshot
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


class CriticLearner:
    """Learns from whole generations of experience and returns a `Snapshot` for the next offspring.

    Args:
        spec: Task.
        settings: Settings of the run.
        workers: Threads of critic training.
        seen: What the networks see of the robot, where that is not just its observation.

    Attributes:
        version: Critic training steps done since the start of the run.
        newest: Newest generation in the replay buffer, -1 when it is empty.

    Raises:
        SettingsError: The device cannot be used here.
        PgaError: The machine cannot reserve memory for `replay_size` transitions.
    """

    def __init__(
        self,
        spec: TaskSpec,
        settings: Settings,
        workers: int = 1,
        seen: RobotDimensions | None = None,
    ) -> None:
        self._spec = spec
        self._settings = settings
        self._dimensions = seen or spec
        self._trainer = CriticTrainer(self._dimensions, settings, workers)
        self.version = 0
        self.newest = -1
        self._clear_replay()

    def forget_experience(self) -> None:
        """Empty the replay buffer, so that it can be filled again from stored experience."""
        self._clear_replay()
        self.newest = -1

    def add(self, generation: int, episodes: Iterable[Episode]) -> None:
        """Add one generation's experience to the replay buffer, in evaluation order (Alg. 3 line 20).

        Args:
            generation: Number of the generation, `newest` + 1.
            episodes: All its episodes.

        Raises:
            PgaError: An episode comes from another robot.
        """
        for e in episodes:
            self._replay.add_episode(
                e.states, e.actions, e.rewards, e.terminated, self._spec.max_steps
            )
        self.newest = generation

    def start_greedy_at(self, parameters: Float32Array) -> None:
        """Start the greedy controller as a copy of a controller (setting ``greedy_init: best``).

        Args:
            parameters: (P,) float32.

        Raises:
            NetworkError: The parameters do not fit the controllers' layers, or are not finite.
        """
        self._trainer.set_greedy(parameters)

    def train(self, rates: Settings, generation: int) -> Snapshot:
        """Train (Alg. 4) and return what a generation's offspring are made with.

        Args:
            rates: Settings with the rates in force.
            generation: Generation of these offspring.

        Raises:
            PgaError: The replay buffer is empty.
            NetworkError: The training diverged.
        """
        steps = self._steps(rates)
        losses = self._trainer.train(self._replay, rates, generation, steps)
        self.version += len(steps)
        sets = 1 if self._settings.pg_batches == "shared" else self._settings.batch_size
        states = [
            self._replay.state_batches(
                generator(self._settings.seed, Purpose.PG_BATCHES, generation, i),
                rates.n_grad,
                self._settings.transition_batch,
            )
            for i in range(sets)
        ]
        return Snapshot(
            generation=generation,
            version=self.version,
            networks={
                CRITIC: (self._trainer.critic_shape, self._trainer.critic_parameters()),
                GREEDY: (self._trainer.greedy_shape, self._trainer.greedy_parameters()),
            },
            states=np.stack(states),
            transitions=len(self._replay),
            critic_loss=losses["critic_loss"],
            mean_q=losses["mean_q"],
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """Return networks, targets and optimizers by name; the replay buffer is stored as experience."""
        return self._trainer.state()

    def load_state(self, state: dict[str, NDArray[Any]], version: int) -> None:
        """Continue from a stored state, bit for bit.

        Args:
            state: What `state` returned.
            version: Training steps done by then.

        Raises:
            StorageError: Arrays are missing or do not fit the settings.
        """
        self._trainer.load_state(state)
        self.version = version

    def _steps(self, rates: Settings) -> range:
        """Return the numbers of the steps of a training; each counts its own (Alg. 4 line 2)."""
        return range(1, rates.n_crit + 1)

    def _clear_replay(self) -> None:
        dims = (self._dimensions.observation_dim, self._dimensions.action_dim)
        self._replay = ReplayBuffer(self._settings.replay_size, *dims)
