"""The replay buffer B of Alg. 3: a first-in-first-out ring of transitions, one packed row each."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pga_me_ros.arrays import Float32Array, Int64Array
from pga_me_ros.errors import PgaError


class TransitionSource(Protocol):
    """What critics train on: rows [state, action, next state, reward, not_done], drawn by index."""

    def sample_indices(self, rng: np.random.Generator, n: int) -> Int64Array:
        """Draw n transitions, see `ReplayBuffer.sample_indices`."""
        ...

    def rows(self, indices: Int64Array, out: Float32Array | None = None) -> Float32Array:
        """Return the rows of some transitions, see `ReplayBuffer.rows`."""
        ...


class ReplayBuffer:
    """The newest transitions, oldest first by index.

    A row is [state, action, next state, reward, not_done], so that a training batch is one gather
    from memory. Memory is reserved at once, but used only as rows are written.

    Args:
        capacity: Number of transitions kept; older ones are overwritten.
        obs_dim: Numbers per state.
        act_dim: Numbers per action.

    Raises:
        PgaError: The machine cannot reserve that much memory.
    """

    def __init__(self, capacity: int, obs_dim: int, act_dim: int) -> None:
        """Reserve memory for `capacity` rows."""
        self.capacity = capacity
        self.obs_dim = obs_dim
        self.act_dim = act_dim
        self.width = 2 * obs_dim + act_dim + 2
        try:
            self._ring = Ring(capacity, self.width)
        except MemoryError as error:
            raise PgaError(
                f"replay_size={capacity} transitions take {4e-9 * capacity * self.width:.1f} GB, "
                "more than this machine can reserve; choose a smaller replay_size."
            ) from error

    def __len__(self) -> int:
        """Return the number of transitions held."""
        return len(self._ring)

    def add_episode(
        self,
        states: Float32Array,
        actions: Float32Array,
        rewards: Float32Array,
        terminated: bool,
        max_steps: int | None = None,
    ) -> None:
        """Add the T transitions of one episode, in order.

        not_done is 0 in the last row of an episode that ended by a fall before the time limit, and
        1 elsewhere: values extend beyond the time limit, as in the authors' code.

        Args:
            states: (T + 1, obs_dim) float32, the first observation to the last.
            actions: (T, act_dim) float32.
            rewards: (T,) float32.
            terminated: Whether the task ended the episode (a fall), rather than the time limit.
            max_steps: Time limit in steps; a fall in the last step counts as the limit. None for
                no limit.

        Raises:
            PgaError: The arrays do not fit together or are not of this robot.
        """
        steps = len(actions)
        expected = ((steps + 1, self.obs_dim), (steps, self.act_dim), (steps,))
        got = (np.shape(states), np.shape(actions), np.shape(rewards))
        if got != expected:
            raise PgaError(
                f"Episode arrays (states, actions, rewards) have shapes {got}, "
                f"expected {expected}; an episode of T steps has T + 1 states."
            )
        rows = np.empty((steps, self.width), np.float32)
        n_s, n_a = self.obs_dim, self.act_dim
        rows[:, :n_s] = states[:-1]
        rows[:, n_s : n_s + n_a] = actions
        rows[:, n_s + n_a : -2] = states[1:]
        rows[:, -2] = rewards
        rows[:, -1] = 1.0
        if terminated and steps and (max_steps is None or steps < max_steps):
            rows[-1, -1] = 0.0
        self._ring.append(rows)

    def sample_indices(self, rng: np.random.Generator, n: int) -> Int64Array:
        """Draw n transitions uniformly with replacement.

        Returns:
            (n,) int64 indices, 0 the oldest transition held.

        Raises:
            PgaError: The buffer is empty.
        """
        if not len(self):
            raise PgaError("The replay buffer is empty; add episodes before drawing from it.")
        return rng.integers(0, len(self), n)

    def rows(self, indices: Int64Array, out: Float32Array | None = None) -> Float32Array:
        """Return the rows of some transitions.

        Args:
            indices: (n,) int64, 0 the oldest transition held; below `len`.
            out: (n, width) float32 to write to.

        Returns:
            (n, width) float32, a copy.
        """
        return self._ring.take(indices, out)

    def state_batches(self, rng: np.random.Generator, n_batches: int, n: int) -> Float32Array:
        """Draw batches of states, as PG variation takes them (Alg. 5).

        Returns:
            (n_batches, n, obs_dim) float32, contiguous.

        Raises:
            PgaError: The buffer is empty.
        """
        rows = self.rows(self.sample_indices(rng, n_batches * n))
        return np.ascontiguousarray(rows[:, : self.obs_dim]).reshape(n_batches, n, self.obs_dim)


class Ring:
    """The newest rows, oldest first by index.

    Memory is reserved at once, but used only as rows are written.

    Args:
        capacity: Number of rows kept; older ones are overwritten.
        width: Numbers per row.

    Raises:
        MemoryError: The machine cannot reserve that much memory.
    """

    def __init__(self, capacity: int, width: int) -> None:
        self._rows = np.empty((capacity, width), np.float32)
        self._size = 0
        self._oldest = 0

    def __len__(self) -> int:
        """Return the number of rows held."""
        return self._size

    def append(self, rows: Float32Array) -> None:
        """Add (n, width) float32 rows, in order."""
        capacity = len(self._rows)
        rows = rows[-capacity:]
        start = (self._oldest + self._size) % capacity
        before_wrap = min(len(rows), capacity - start)
        self._rows[start : start + before_wrap] = rows[:before_wrap]
        self._rows[: len(rows) - before_wrap] = rows[before_wrap:]
        overwritten = max(0, self._size + len(rows) - capacity)
        self._oldest = (self._oldest + overwritten) % capacity
        self._size += len(rows) - overwritten

    def take(self, indices: Int64Array, out: Float32Array | None = None) -> Float32Array:
        """Return some rows.

        Args:
            indices: (n,) int64, 0 the oldest row held; below `len`.
            out: (n, width) float32 to write to.

        Returns:
            (n, width) float32, a copy.
        """
        # Indices count from the oldest row, wherever it lies in the ring: a ring that was saved and read
        # back gives the same rows although it starts elsewhere.
        return np.take(self._rows, indices + self._oldest, axis=0, out=out, mode="wrap")
