"""The learner of QD-RL: critics of quality and of diversity on one replay buffer (Cideron et al. 2020)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.algorithms.qd_rl.diversity_replay import DiversityReplay
from pga_me_ros.core.algorithms.qd_rl.state_archive import StateArchive
from pga_me_ros.core.algorithms.qd_rl.state_descriptors import (
    require_step_descriptor,
    state_descriptors,
)
from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.learning.critic_trainer import CriticTrainer
from pga_me_ros.core.rng import Purpose
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import DIVERSITY_CRITIC, Snapshot
from pga_me_ros.errors import StorageError
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec

DIVERSITY = "diversity_"
"""Prefix of the diversity critics' arrays; the quality critics' arrays have the same names without it."""

POINTS, SEEN = "state_archive", "state_archive_newest"


class QdRlLearner(CriticLearner):
    """Trains a second pair of critics, with its own greedy controller, on novelty instead of reward.

    Before each training, the archive of state descriptors is updated with the transitions of new generations that are
    still in the replay buffer. So it depends on the trainings alone, not on the process that did them or on how often
    the replay buffer was refilled in between.

    Args:
        spec: Task, which must have state descriptors.
        settings: Settings of the run.
        workers: Threads of critic training.

    Attributes:
        diversity_transitions: Transitions that the diversity critics train on.

    Raises:
        TaskError: The task has no state descriptors.
        SettingsError: The device cannot be used here.
        PgaError: The machine cannot reserve memory for `replay_size` transitions.
    """

    diversity_transitions: DiversityReplay
    _unseen: int  # transitions added since the archive was last updated

    def __init__(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> None:
        require_step_descriptor(spec)
        self._archive = StateArchive(
            spec.descriptor_dim, settings.state_archive_size, settings.state_spacing
        )
        self._seen = -1  # newest generation in the archive
        super().__init__(spec, settings, workers)
        self._diversity_trainer = CriticTrainer(
            spec, settings, workers, Purpose.DIVERSITY_TRAINING, first_draw=3
        )

    def add(self, generation: int, episodes: Iterable[Episode]) -> None:
        """Add one generation's experience as `CriticLearner` does, with its state descriptors."""
        episodes = list(episodes)
        super().add(generation, episodes)
        for episode in episodes:
            self.diversity_transitions.describe(state_descriptors(self._spec, episode))
            self._unseen += episode.length if generation > self._seen else 0

    def train(self, rates: Settings, generation: int) -> Snapshot:
        """Train both pairs of critics, the quality critics as `CriticLearner` does."""
        snapshot = super().train(rates, generation)
        self._archive.add(self.diversity_transitions.newest_descriptors(self._unseen))
        self._seen, self._unseen = self.newest, 0
        self._diversity_trainer.train(self.diversity_transitions, rates, generation)
        trainer = self._diversity_trainer
        critic = (trainer.critic_shape, trainer.critic_parameters())
        return dataclasses.replace(
            snapshot, networks={**snapshot.networks, DIVERSITY_CRITIC: critic}
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the state of `CriticLearner`, of the diversity critics, and the archive of state descriptors."""
        diversity = self._diversity_trainer.state()
        return {
            **super().state(),
            **{f"{DIVERSITY}{name}": array for name, array in diversity.items()},
            POINTS: self._archive.points.copy(),
            SEEN: np.array(self._seen, np.int64),
        }

    def load_state(self, state: dict[str, NDArray[Any]], version: int) -> None:
        """Continue from a stored state, bit for bit, once the replay buffer is filled again.

        Raises:
            StorageError: Arrays are missing or do not fit the settings.
        """
        points, seen = self._checked_archive(state)
        own = {name: a for name, a in state.items() if not name.startswith(DIVERSITY)}
        others = {
            name.removeprefix(DIVERSITY): a
            for name, a in state.items()
            if name.startswith(DIVERSITY)
        }
        self._diversity_trainer.load_state(others)
        super().load_state(own, version)
        self._archive.points, self._seen = points, seen
        # `add` counts the transitions that the archive has not seen, so they must be added again.
        self.forget_experience()

    def _checked_archive(self, state: dict[str, NDArray[Any]]) -> tuple[Float32Array, int]:
        points, seen = state.get(POINTS), state.get(SEEN)
        dimensions = self._spec.descriptor_dim
        if points is None or seen is None or seen.size != 1:
            raise StorageError(
                f"The saved critics lack '{POINTS}' or '{SEEN}', so they are not of algorithm 'qd_rl'; resume with the "
                "algorithm that the run was started with."
            )
        if points.dtype != np.float32 or points.ndim != 2 or points.shape[1] != dimensions:
            raise StorageError(
                f"Saved critic array '{POINTS}' is {points.dtype} {points.shape}, expected float32 (n, {dimensions}); "
                "resume with the task that the run was started with."
            )
        return np.array(points), int(seen)

    def _clear_replay(self) -> None:
        super()._clear_replay()
        self._unseen = 0
        self.diversity_transitions = DiversityReplay(
            self._replay,
            self._spec.descriptor_dim,
            self._archive,
            self._settings.novelty_neighbors,
        )
