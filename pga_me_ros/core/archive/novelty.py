"""Novelty: how far a descriptor lies from the nearest ones of a set (Lehman & Stanley 2011), as QD-RL rewards it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.archive.geometry import checked_box, squared_distances

_BLOCK_NUMBERS = 1 << 17
"""Distances computed at a time: few enough to stay in the cache."""


def unit_box(descriptors: ArrayLike, low: ArrayLike, high: ArrayLike) -> Float64Array:
    """Return descriptors with every dimension in shares of its range, so that all count equally in distances.

    Args:
        descriptors: (n, d) numbers; those beyond the bounds count as at the bounds.
        low: Lower bound of each of the d dimensions.
        high: Upper bounds.

    Returns:
        (n, d) float64 within [0, 1].

    Raises:
        ArchiveError: The bounds do not enclose a box.
    """
    lower, upper = checked_box(np.asarray(low).tolist(), np.asarray(high).tolist())
    return np.clip((np.asarray(descriptors, np.float64) - lower) / (upper - lower), 0.0, 1.0)


def novelty(
    points: Float64Array, others: Float64Array, k: int, *, themselves: bool = False
) -> Float64Array:
    """Return the mean Euclidean distance of each point to the k nearest of the others.

    The result for a point does not depend on the other points of the call.

    Args:
        points: (n, d) float64.
        others: (m, d) float64; if there are fewer than k, the mean is over all of them.
        k: Number of neighbors, at least 1.
        themselves: Whether points and others are the same set, of which no point is its own neighbor.

    Returns:
        (n,) float64; zeros if there is no neighbor.
    """
    out = np.zeros(len(points))
    k = min(k, len(others) - themselves)
    if k < 1:
        return out
    for rows, squares in squared_distances(points, others, _BLOCK_NUMBERS):
        if themselves:
            squares[np.arange(len(squares)), np.arange(len(points))[rows]] = np.inf
        nearest = np.partition(squares, k - 1, axis=1)[:, :k]
        nearest.sort(axis=1)  # the order that partition leaves would decide the last bit of the sum
        out[rows] = np.sqrt(nearest).mean(axis=1)
    return out


def nearest_distance(points: Float64Array, others: Float64Array) -> Float64Array:
    """Return the (n,) float64 Euclidean distances of (n, d) points to the nearest of (m, d) others, inf for m = 0."""
    out = np.full(len(points), np.inf)
    if len(others):
        for rows, squares in squared_distances(points, others, _BLOCK_NUMBERS):
            out[rows] = np.sqrt(squares.min(axis=1))
    return out
