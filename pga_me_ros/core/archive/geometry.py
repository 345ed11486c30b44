"""Distances between two sets of points, block by block; each is the same whatever else is computed with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.errors import ArchiveError

_BLOCK_NUMBERS = 1 << 19
"""Distances computed at a time: few enough to stay in the cache."""
_TILES = 30
"""Tiles of a raster along each side: a tile is compared with all centroids, its points only with near ones."""
_ROUNDING = 1e-9
"""Slack on distances, far above their rounding errors."""


def squared_distances(
    points: Float64Array, others: Float64Array, numbers: int
) -> Iterator[tuple[slice, Float64Array]]:
    """Yield rows of points and their squared Euclidean distances to all others.

    Args:
        points: (n, d) array.
        others: (m, d) array, m at least 1.
        numbers: Approximate number of distances at a time.

    Yields:
        The rows, and their (rows, m) float64 squared distances.
    """
    columns = np.ascontiguousarray(others.T)
    block = max(1, numbers // len(others))
    for start in range(0, len(points), block):
        part = points[start : start + block]
        squares = np.zeros((len(part), len(others)))
        for axis, column in enumerate(columns):
            difference = part[:, axis, None] - column
            difference *= difference
            squares += difference
        yield slice(start, start + len(part)), squares


def checked_box(low: Sequence[float], high: Sequence[float]) -> tuple[Float64Array, Float64Array]:
    """Return the bounds of a box as two (d,) float64 arrays.

    Raises:
        ArchiveError: The bounds differ in length, are not finite, enclose nothing, or are too far apart for their
            difference to be finite.
    """
    lower, upper = np.array(low, np.float64), np.array(high, np.float64)
    if lower.ndim != 1 or lower.shape != upper.shape or lower.size == 0:
        raise ArchiveError(
            f"Descriptor bounds have shapes {lower.shape} and {upper.shape}; "
            "give two lists of the same length, at least one number each."
        )
    if not (np.isfinite(lower).all() and np.isfinite(upper).all() and (lower < upper).all()):
        raise ArchiveError(
            f"Descriptor bounds are {lower.tolist()} and {upper.tolist()}; "
            "each must be finite and the lower one below the upper one."
        )
    with np.errstate(over="ignore"):
        extent = upper - lower
    if not np.isfinite(extent).all():
        raise ArchiveError(
            f"Descriptor bounds are {lower.tolist()} and {upper.tolist()}; "
            "their difference must be finite too: choose a narrower range."
        )
    return lower, upper


def nearest_centroids(points: Float64Array, centroids: Float64Array) -> Int64Array:
    """Return the nearest centroid of each point; exact ties go to the lowest index.

    Distances are sums of squared differences, evaluated the same way for every point, so that the answer
    for a point does not depend on the other points of the call.

    Args:
        points: (n, d) array.
        centroids: (cells, d) array.

    Returns:
        (n,) int64 array.
    """
    out = np.empty(len(points), np.int64)
    for rows, squares in squared_distances(points, centroids, _BLOCK_NUMBERS):
        out[rows] = squares.argmin(axis=1)
    return out


def nearest_centroids_on_raster(
    x: Float64Array, y: Float64Array, centroids: Float64Array
) -> Int64Array:
    """Return the nearest centroid of each point of a raster, as `nearest_centroids` does.

    The raster is divided into tiles. For the points of a tile, only the centroids near it are compared, so that many
    thousands of cells take seconds, not minutes.

    Args:
        x: (columns,) first coordinates, ascending.
        y: (rows,) second coordinates, ascending or descending.
        centroids: (cells, 2) array.

    Returns:
        (rows, columns) int64 array.
    """
    out = np.empty((len(y), len(x)), np.int64)
    for rows in _tiles(len(y)):
        for columns in _tiles(len(x)):
            across, up = x[columns], y[rows]
            points = np.stack([np.tile(across, len(up)), np.repeat(up, len(across))], axis=1)
            cells = nearest_centroids_of_group(points, centroids)
            out[rows, columns] = cells.reshape(len(up), len(across))
    return out


def nearest_centroids_of_group(points: Float64Array, centroids: Float64Array) -> Int64Array:
    """Return the nearest centroid of each point, as `nearest_centroids` does, quickly for points close together.

    By the triangle inequality, the centroid nearest to any of them is no farther from their center than the one nearest
    to the center, plus twice the radius.

    Args:
        points: (n, d) array, n at least 1.
        centroids: (cells, d) array.

    Returns:
        (n,) int64 array.
    """
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = np.sqrt(((points - center) ** 2).sum(axis=1).max())
    distance = np.sqrt(((centroids - center) ** 2).sum(axis=1))
    near = np.flatnonzero(distance <= (distance.min() + 2 * radius) * (1 + _ROUNDING))
    return near[nearest_centroids(points, centroids[near])]


def _tiles(size: int) -> list[slice]:
    edges = np.linspace(0, size, min(size, _TILES) + 1).astype(int).tolist()
    return [slice(a, b) for a, b in pairwise(edges)]
