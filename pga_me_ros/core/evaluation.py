"""One evaluation: its id, its initial pose, and the noise on its actions, as functions of the settings and its id."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings

Act = Callable[[Float32Array], Float32Array]


def exploring(controller: Act, sigma: float, seed: int, evaluation: int) -> Act:
    """Return a controller whose actions are those of another one plus Gaussian noise, clipped to -1..1.

    An actor explores like this (Alg. 2 line 7, Nilsson & Cully 2021). Like the initial pose, the noise depends on the
    evaluation: repeating the evaluation draws the same noise.

    Args:
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32.
        sigma: Standard deviation of the noise; 0 returns the controller as it is.
        seed: Seed of the run.
        evaluation: Id of the evaluation; the controller returned is for this one episode.
    """
    if sigma == 0.0:
        return controller
    rng = generator(seed, Purpose.EXPLORATION, 0, evaluation)
    scale = np.float32(sigma)

    def act(observation: Float32Array) -> Float32Array:
        action = controller(observation)
        noise = rng.standard_normal(action.shape, np.float32) * scale
        return np.clip(action + noise, np.float32(-1.0), np.float32(1.0))

    return act


def as_evaluated(settings: Settings, controller: Act, evaluation: int) -> Act:
    """Return a controller as it acted, or will act, in an evaluation of a run.

    Args:
        settings: Settings of the run.
        controller: The controller of that evaluation, see `exploring`.
        evaluation: Id of the evaluation.
    """
    generation = evaluation // settings.batch_size
    sigma = algorithm_of(settings).exploration_sigma(settings, generation)
    return exploring(controller, sigma, settings.seed, evaluation)


def evaluation_ids(settings: Settings, generation: int) -> range:
    """Return the evaluation ids of a generation: whole batches, counted from 0."""
    return range(generation * settings.batch_size, (generation + 1) * settings.batch_size)


def reevaluation_rng(seed: int, repeat: int) -> np.random.Generator:
    """Return the generator of the initial pose of a re-evaluation.

    All controllers begin a repeat in the same pose, so that what differs between them is their own doing.
    """
    return generator(seed, Purpose.REEVALUATION, 0, repeat)


def evaluation_rng(seed: int, evaluation: int) -> np.random.Generator:
    """Return the generator of one evaluation's initial pose; ids are unique, so it needs no generation."""
    return generator(seed, Purpose.EVALUATION, 0, evaluation)
