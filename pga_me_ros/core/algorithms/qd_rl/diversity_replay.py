"""Transitions whose reward is novelty: what QD-RL's diversity critics train on (Cideron et al. 2020)."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float32Array, Int64Array
from pga_me_ros.core.algorithms.qd_rl.state_archive import StateArchive
from pga_me_ros.core.learning.replay_buffer import ReplayBuffer, Ring
from pga_me_ros.errors import PgaError

REWARD = -2
"""Column of the reward in a row."""


class DiversityReplay:
    """The transitions of a replay buffer with their state descriptors, rewarded by the descriptors' novelty.

    The reward is computed when a transition is drawn, against the current archive: novelty fades over time.

    Args:
        replay: The transitions.
        dimensions: Numbers per state descriptor.
        archive: Archive that novelty is measured against.
        neighbors: Number of nearest state descriptors in the archive to use.

    Raises:
        PgaError: The machine cannot reserve memory for the state descriptors.
    """

    def __init__(
        self, replay: ReplayBuffer, dimensions: int, archive: StateArchive, neighbors: int
    ) -> None:
        self._replay = replay
        self._archive = archive
        self._neighbors = neighbors
        try:
            self._descriptors = Ring(replay.capacity, dimensions)
        except MemoryError as error:
            raise PgaError(
                f"The state descriptors of replay_size={replay.capacity} transitions take more memory than this "
                "machine gives; make replay_size smaller."
            ) from error

    def describe(self, descriptors: Float32Array) -> None:
        """Add the state descriptors (n, d) of the n transitions last added to the replay buffer."""
        self._descriptors.append(descriptors)

    def newest_descriptors(self, n: int) -> Float32Array:
        """Return the state descriptors (m, d) of the newest n transitions, or of all if fewer, oldest first."""
        held = len(self._descriptors)
        return self._descriptors.take(np.arange(max(held - n, 0), held))

    def sample_indices(self, rng: np.random.Generator, n: int) -> Int64Array:
        """Draw n transitions as the replay buffer does."""
        return self._replay.sample_indices(rng, n)

    def rows(self, indices: Int64Array, out: Float32Array | None = None) -> Float32Array:
        """Return rows of the replay buffer, (n, width) float32, with novelty as the reward."""
        rows = self._replay.rows(indices, out)
        descriptors = self._descriptors.take(indices)
        rows[:, REWARD] = self._archive.novelty(descriptors, self._neighbors)
        return rows
