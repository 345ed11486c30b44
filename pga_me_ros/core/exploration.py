"""Exploration noise on a controller's actions, as a function of the evaluation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.rng import Purpose, generator

Act = Callable[[Float32Array], Float32Array]


@dataclass(frozen=True)
class Noise:
    """Gaussian noise, independent for each entry of an action.

    With a correlation c, its value at a step is c times that of the step before plus sqrt(1 - c^2) times a fresh one,
    so its standard deviation is sigma at every step. This is an Ornstein-Uhlenbeck process, as DDPG explores with
    (Lillicrap et al. 2016).

    Attributes:
        sigma: Standard deviation; 0 for no noise.
        correlation: c, from 0 (independent steps, as TD3 explores) to below 1.
    """

    sigma: float = 0.0
    correlation: float = 0.0


QUIET = Noise()
"""No noise."""


def exploring(controller: Act, noise: Noise, seed: int, evaluation: int) -> Act:
    """Return a controller whose actions are those of another one plus Gaussian noise, clipped to -1..1.

    An actor explores like this (Alg. 2 line 7, Nilsson & Cully 2021). Like the initial pose, the noise depends on the
    evaluation: repeating the evaluation draws the same noise.

    Args:
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32.
        noise: Distribution of the noise; `QUIET` returns the controller as it is.
        seed: Seed of the run.
        evaluation: Id of the evaluation; the controller returned is for this one episode.
    """
    if noise.sigma == 0.0:
        return controller
    rng = generator(seed, Purpose.EXPLORATION, 0, evaluation)
    scale, kept = np.float32(noise.sigma), np.float32(noise.correlation)
    fresh = np.float32(math.sqrt(1.0 - noise.correlation**2))
    last: Float32Array | None = None

    def act(observation: Float32Array) -> Float32Array:
        nonlocal last
        action = controller(observation)
        drawn = rng.standard_normal(action.shape, np.float32)
        last = drawn if last is None else kept * last + fresh * drawn
        return np.clip(action + last * scale, np.float32(-1.0), np.float32(1.0))

    return act
