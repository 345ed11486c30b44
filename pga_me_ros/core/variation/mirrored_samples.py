"""Samples of an evolution strategy, in mirrored pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import RequestError


def es_noise(settings: Settings, generation: int) -> Callable[[int], np.random.Generator]:
    """Return a function that gives the random generator of each mirrored pair of a generation's samples."""
    return lambda pair: generator(settings.seed, Purpose.ES_NOISE, generation, pair)


def es_samples(
    settings: Settings, center: Float32Array, generation: int, first: int, count: int
) -> Float32Array:
    """Return samples of MAP-Elites-ES for consecutive places of a batch; place 0 holds no sample.

    Args:
        settings: Settings of the run.
        center: (P,) float32 parameters around which they are drawn.
        generation: Their generation.
        first: Place of the first one, at least 1.
        count: Number of samples, at least 1.

    Returns:
        (count, P) float32 parameters.

    Raises:
        RequestError: A place is 0 or beyond `es_samples`.
    """
    if not 1 <= first <= first + count - 1 <= settings.es_samples:
        raise RequestError(
            f"Samples for places {first} to {first + count - 1} were requested; samples have places 1 to "
            f"{settings.es_samples}."
        )
    return mirrored(center, settings.es_sigma, es_noise(settings, generation), first - 1, count)


def mirrored(
    center: Float32Array,
    sigma: float,
    noise: Callable[[int], np.random.Generator],
    first: int,
    count: int,
) -> Float32Array:
    """Return consecutive samples around a center: 2i is center + sigma * eps_i, 2i + 1 is center - sigma * eps_i.

    Args:
        center: (P,) float32.
        sigma: Standard deviation of the samples, in each entry.
        noise: Returns the generator of pair i.
        first: Number of the first sample.
        count: Number of samples, at least 1.

    Returns:
        (count, P) float32; a sample is the same however they are divided among calls.
    """
    out = np.empty((count, len(center)), np.float32)
    for pair in range(first // 2, (first + count - 1) // 2 + 1):
        step = np.float32(sigma) * _direction(noise(pair), len(center))
        for sample, mirror in ((2 * pair, step), (2 * pair + 1, -step)):
            if first <= sample < first + count:
                out[sample - first] = center + mirror
    return out


def directions(
    noise: Callable[[int], np.random.Generator], pairs: int, size: int
) -> Iterator[Float32Array]:
    """Yield eps of pair 0, 1, ..., as `mirrored` draws it."""
    return (_direction(noise(pair), size) for pair in range(pairs))


def _direction(rng: np.random.Generator, size: int) -> Float32Array:
    return rng.standard_normal(size, np.float32)
