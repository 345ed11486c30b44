"""Evolution strategies on flat vectors: mirrored samples, ranks, the gradient estimate, Adam.

As in Salimans et al. (2017) and in MAP-Elites-ES (Colas et al. 2020), which builds on it. NumPy alone, without matrix
products: the order of summation must not depend on the BLAS library or its number of threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import Float32Array, Float64Array

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8
"""Adam's defaults (Kingma & Ba 2015), which the authors of MAP-Elites-ES use."""


def centered_ranks(values: ArrayLike) -> Float64Array:
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

    It is the mean over pairs of (w+ - w-) * eps. For weights that are values of a smooth function, that is 2 * sigma
    times its gradient plus higher-order terms; the authors do not divide by sigma either.

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
    """The state of Adam.

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
        """Return the state before the first step."""
        return cls(np.zeros(size), np.zeros(size), 0)


def adam_ascent(
    point: Float32Array, slope: Float64Array, moments: Moments, learning_rate: float
) -> tuple[Float32Array, Moments]:
    """Take one step of Adam upwards (Kingma & Ba 2015, Alg. 1).

    Args:
        point: (P,) float32.
        slope: (P,) float64 gradient there.
        moments: Adam's state after earlier steps.
        learning_rate: Adam's step size.

    Returns:
        The next point, and Adam's next state.
    """
    steps = moments.steps + 1
    mean = BETA1 * moments.mean + (1.0 - BETA1) * slope
    square = BETA2 * moments.square + (1.0 - BETA2) * slope * slope
    step = (mean / (1.0 - BETA1**steps)) / (np.sqrt(square / (1.0 - BETA2**steps)) + EPSILON)
    return (point + learning_rate * step).astype(np.float32), Moments(mean, square, steps)
