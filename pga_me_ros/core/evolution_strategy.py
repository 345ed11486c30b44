"""Evolution strategies on flat vectors: mirrored samples, ranks, the gradient estimate, Adam, novelty.

As in Salimans et al. (2017) and in MAP-Elites-ES (Colas et al. 2020), which is built of them. NumPy alone, and no
matrix products: sums have one order, whatever library of linear algebra is installed and however many threads it has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8
"""Adam's own (Kingma & Ba 2015), as coded by the authors of MAP-Elites-ES."""


def mirrored(
    center: Float32Array,
    sigma: float,
    noise: Callable[[int], np.random.Generator],
    first: int,
    count: int,
) -> Float32Array:
    """Return consecutive samples around a centre: 2i is centre + sigma * eps_i, 2i + 1 is centre - sigma * eps_i.

    Args:
        center: (P,) float32.
        sigma: Standard deviation of the samples, in each entry.
        noise: Returns the generator of pair i.
        first: Number of the first sample.
        count: How many, at least 1.

    Returns:
        (count, P) float32; a sample is the same in whatever division of all of them.
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
    """Yield eps of pair 0, 1, ...: what `mirrored` draws."""
    return (_direction(noise(pair), size) for pair in range(pairs))


def _direction(rng: np.random.Generator, size: int) -> Float32Array:
    return rng.standard_normal(size, np.float32)


def centred_ranks(values: ArrayLike) -> Float64Array:
    """Return ranks from -0.5 (least) to 0.5 (greatest), equal values sharing the mean of their ranks.

    Args:
        values: (n,) numbers, n at least 2.

    Returns:
        (n,) float64; their sum is 0.
    """
    _, which, counts = np.unique(
        np.asarray(values, np.float64), return_inverse=True, return_counts=True
    )
    least = np.cumsum(counts) - counts
    ranks = (least + (counts - 1) / 2.0)[which]
    return ranks / (len(ranks) - 1) - 0.5


def gradient(weights: ArrayLike, noise: Iterator[Float32Array], size: int) -> Float64Array:
    """Estimate the direction in which samples have greater weights, from mirrored pairs.

    It is the mean over pairs of (w+ - w-) * eps. Where weights are values of a smooth function, that is 2 * sigma times
    its gradient plus terms of higher order; the authors do not divide by sigma either.

    Args:
        weights: (2n,) weights of the samples, in the order of `mirrored`.
        noise: n directions, (size,) each.
        size: Entries of a vector.

    Returns:
        (size,) float64.
    """
    pairs = np.asarray(weights, np.float64).reshape(-1, 2)
    total = np.zeros(size)
    for (plus, minus), direction in zip(pairs.tolist(), noise, strict=True):
        total += (plus - minus) * direction
    return total / len(pairs)


@dataclass(frozen=True)
class Moments:
    """What Adam remembers.

    Attributes:
        mean: (P,) float64 running mean of the gradients.
        square: (P,) float64 running mean of their squares.
        steps: Steps taken.
    """

    mean: Float64Array
    square: Float64Array
    steps: int

    @classmethod
    def none(cls, size: int) -> Moments:
        """Return those before the first step."""
        return cls(np.zeros(size), np.zeros(size), 0)


def adam_ascent(
    point: Float32Array, slope: Float64Array, moments: Moments, learning_rate: float
) -> tuple[Float32Array, Moments]:
    """Take one step of Adam upwards (Kingma & Ba 2015, Alg. 1).

    Args:
        point: (P,) float32.
        slope: (P,) float64 gradient there.
        moments: What Adam remembers of earlier steps.
        learning_rate: Adam's step size.

    Returns:
        The next point, and what to remember.
    """
    steps = moments.steps + 1
    mean = BETA1 * moments.mean + (1.0 - BETA1) * slope
    square = BETA2 * moments.square + (1.0 - BETA2) * slope * slope
    step = (mean / (1.0 - BETA1**steps)) / (np.sqrt(square / (1.0 - BETA2**steps)) + EPSILON)
    return (point + learning_rate * step).astype(np.float32), Moments(mean, square, steps)


def novelty(behaviors: Float64Array, others: Float64Array, k: int) -> Float64Array:
    """Return the mean Euclidean distance of each behaviour to its k nearest others, or to all if there are fewer.

    Args:
        behaviors: (n, d) float64.
        others: (m, d) float64, m at least 1.
        k: Neighbours, at least 1.

    Returns:
        (n,) float64.
    """
    squares = np.zeros((len(behaviors), len(others)))
    for column, other in zip(behaviors.T, others.T, strict=True):
        squares += (column[:, None] - other[None, :]) ** 2
    return np.sqrt(np.sort(squares, axis=1)[:, :k]).mean(axis=1)
