"""The controllers of a batch, from random ones to GA and PG offspring (Alg. 3 line 10, Alg. 5), and samples of ES.

Each controller depends on the run's seed, its generation, its place in the batch and its parents alone, so any division
of a batch among calls or processes gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.evolution_strategy import mirrored
from pga_me_ros.core.policy import MlpShape, random_parameters
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.variation import ga_variation

Float32Array = NDArray[np.float32]


def random_controllers(
    settings: Settings, shape: MlpShape, generation: int, first: int, count: int
) -> Float32Array:
    """Return random controllers for consecutive places of a batch (Alg. 3 line 10).

    Args:
        settings: Settings of the run.
        shape: Layers of the controllers.
        generation: Their generation.
        first: Place of the first one.
        count: How many, at least 1.

    Returns:
        (count, P) float32 parameters.
    """
    return np.stack(
        [
            random_parameters(
                shape, generator(settings.seed, Purpose.RANDOM_CONTROLLER, generation, place)
            )
            for place in range(first, first + count)
        ]
    )


def ga_offspring(
    settings: Settings, shape: MlpShape, generation: int, first: int, parents: Float32Array
) -> Float32Array:
    """Return GA offspring for consecutive places of a batch (Eq. 6).

    Args:
        settings: Settings with the rates in force.
        shape: Layers of the controllers.
        generation: Generation of the offspring.
        first: Place of the first one.
        parents: (n, 2, P) float32 parameters.

    Returns:
        (n, P) float32 parameters.

    Raises:
        NetworkError: A parent does not fit the layers.
    """
    return np.stack(
        [
            ga_variation(
                parent_a,
                parent_b,
                settings.iso_sigma,
                settings.line_sigma,
                generator(settings.seed, Purpose.GA_VARIATION, generation, first + i),
                shape,
                settings.line_noise,
            )
            for i, (parent_a, parent_b) in enumerate(parents)
        ]
    )


def es_noise(settings: Settings, generation: int) -> Callable[[int], np.random.Generator]:
    """Return what draws each mirrored pair of a generation's samples."""
    return lambda pair: generator(settings.seed, Purpose.ES_NOISE, generation, pair)


def es_samples(
    settings: Settings, center: Float32Array, generation: int, first: int, count: int
) -> Float32Array:
    """Return samples of MAP-Elites-ES for consecutive places of a batch, whose first place is not a sample's.

    Args:
        settings: Settings of the run.
        center: (P,) float32 what they surround.
        generation: Their generation.
        first: Place of the first one, at least 1.
        count: How many, at least 1.

    Returns:
        (count, P) float32 parameters.

    Raises:
        RequestError: There are no samples in those places.
    """
    if not 1 <= first <= first + count - 1 <= settings.es_samples:
        raise RequestError(
            f"Samples for the places {first} to {first + count - 1} are asked for; theirs are 1 to "
            f"{settings.es_samples}."
        )
    return mirrored(center, settings.es_sigma, es_noise(settings, generation), first - 1, count)


def pg_states(snapshot: Snapshot, first: int, count: int) -> Float32Array:
    """Return the replay states that PG offspring at the given places climb on (Alg. 5 line 16).

    Args:
        snapshot: State of the critics for their generation.
        first: Place of the first one.
        count: How many.

    Returns:
        (n_grad, N, observation_dim) when all share them, else (count, n_grad, N, observation_dim).

    Raises:
        RequestError: The snapshot has no states for those places.
    """
    sets = len(snapshot.states)
    if sets == 1:
        return snapshot.states[0]
    if first + count > sets:
        raise RequestError(
            f"Places {first} to {first + count - 1} are asked for, but the snapshot of generation "
            f"{snapshot.generation} has states for {sets} places."
        )
    return snapshot.states[first : first + count]
