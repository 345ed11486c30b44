"""The batch of transitions of a critic training step."""

# Annotations must stay types: see `compiled`.
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.learning.replay_buffer import TransitionSource
from pga_me_ros.core.settings import Settings


class Transitions(NamedTuple):
    """N transitions in the form that a training step needs.

    Attributes:
        states: (1, N, obs_dim).
        inputs: (1, N, obs_dim + act_dim), states and actions.
        next_states: (1, N, obs_dim).
        rewards: (N, 1).
        not_done: (N, 1).
        noise: (N, act_dim), the smoothing noise epsilon.
        y: (N, 1), the target of the critics.
    """

    states: Tensor
    inputs: Tensor
    next_states: Tensor
    rewards: Tensor
    not_done: Tensor
    noise: Tensor
    y: Tensor


class TrainingBatch:
    """Fetches transitions into memory that is allocated once.

    Args:
        rows: N.
        obs_dim: Numbers per state.
        act_dim: Numbers per action.
        device: Where torch computes.

    Attributes:
        transitions: The latest transitions; `BellmanTarget` fills in y.
    """

    def __init__(self, rows: int, obs_dim: int, act_dim: int, device: torch.device) -> None:
        """Reserve the memory; on a CPU, NumPy and torch share it."""
        both = obs_dim + act_dim
        self._rows = np.zeros((rows, both + obs_dim + 2), np.float32)
        self._noise = np.zeros((rows, act_dim), np.float32)
        self._indices: Int64Array = np.zeros(rows, np.int64)
        self._tensor = torch.from_numpy(self._rows).to(device)
        self.transitions = Transitions(
            states=self._tensor[None, :, :obs_dim],
            inputs=self._tensor[None, :, :both],
            next_states=self._tensor[None, :, both:-2],
            rewards=self._tensor[:, -2:-1],
            not_done=self._tensor[:, -1:],
            noise=torch.from_numpy(self._noise).to(device),
            y=torch.zeros((rows, 1), device=device),
        )

    def draw(self, replay: TransitionSource, rng: np.random.Generator) -> None:
        """Draw the transitions' indices and the smoothing noise (Alg. 4, lines 3-4): all that takes random numbers.

        Raises:
            PgaError: The replay buffer is empty.
        """
        self._indices = replay.sample_indices(rng, len(self._rows))
        rng.standard_normal(dtype=np.float32, out=self._noise)

    def gather(self, replay: TransitionSource, rates: Settings) -> None:
        """Fetch the transitions drawn and scale the noise, once per draw; batches may do so in parallel."""
        replay.rows(self._indices, out=self._rows)
        np.multiply(self._noise, np.float32(rates.smoothing_sigma), out=self._noise)
        np.clip(self._noise, -rates.smoothing_clip, rates.smoothing_clip, out=self._noise)
        if self._tensor.device.type != "cpu":
            self._tensor.copy_(torch.from_numpy(self._rows))
            self.transitions.noise.copy_(torch.from_numpy(self._noise))
