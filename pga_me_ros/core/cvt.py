"""Where the cells of an archive lie: centroidal Voronoi tessellations and regular grids.

A CVT archive spreads its cells evenly over the behaviour space by clustering uniform samples
(section 2.2 of Nilsson & Cully 2021, after Vassiliades et al. 2018): k-means++ seeding, Lloyd's
iterations until hardly any sample changes its cell. The latter skip each sample whose nearest
centroid provably stays the nearest (triangle inequality), which changes nothing but the time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.distances import squared_distances
from pga_me_ros.core.errors import ArchiveError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_ITERATIONS = 300
SETTLED = 1e-3
"""Share of samples that may still change their cell at the end: 0.2 % above the converged error."""
_BLOCK_NUMBERS = 1 << 19
_BLOCK_PRODUCTS = 1 << 18
"""Multiplications per matrix product: so few that BLAS starts no threads, which under load wait for
each other far longer than they work, and which could change the sums."""
_ROUNDING = 1e-7
"""Slack on the unit box: far above the rounding of a distance, far below the size of a cell."""


def cvt_centroids(
    cells: int,
    low: Sequence[float],
    high: Sequence[float],
    samples: int,
    rng: np.random.Generator,
) -> Floats:
    """Return centroids of a centroidal Voronoi tessellation of a box.

    Args:
        cells: Number of cells, at most `samples`.
        low: Least value of each of the d descriptor dimensions.
        high: Greatest values.
        samples: Number of uniform samples that are clustered.
        rng: Generator of samples and seeding. Runs share their centroids by using one that does
            not depend on the run's seed.

    Returns:
        (cells, d) float64 array, each row within the box.

    Raises:
        ArchiveError: The box is empty or not finite, or there are fewer samples than cells.
    """
    lower, upper = checked_box(low, high)
    if not 1 <= cells <= samples:
        raise ArchiveError(
            f"{cells} cells cannot be made of {samples} samples; give at least one cell "
            "and at least as many samples as cells."
        )
    points = rng.random((samples, len(lower)))
    unit = _lloyd(points, _plus_plus(points, cells, rng))
    return np.clip(lower + unit * (upper - lower), lower, upper)


def grid_centroids(bins: Sequence[int], low: Sequence[float], high: Sequence[float]) -> Floats:
    """Return the centres of equal bins, the last dimension varying fastest.

    Args:
        bins: Number of bins of each of the d descriptor dimensions.
        low: Least value of each dimension.
        high: Greatest values.

    Returns:
        (prod(bins), d) float64 array.

    Raises:
        ArchiveError: The box is empty or not finite, or the bins do not fit it.
    """
    lower, upper = checked_box(low, high)
    if len(bins) != len(lower) or min(bins) < 1:
        raise ArchiveError(
            f"bins are {list(bins)}; expected {len(lower)} numbers of at least 1, one a dimension."
        )
    axes = [
        a + (b - a) * (np.arange(n) + 0.5) / n for n, a, b in zip(bins, lower, upper, strict=True)
    ]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def checked_box(low: Sequence[float], high: Sequence[float]) -> tuple[Floats, Floats]:
    """Return the bounds of a box as two (d,) float64 arrays.

    Raises:
        ArchiveError: They differ in length, are not finite, or leave no room between them.
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
    return lower, upper


def nearest_centroids(points: Floats, centroids: Floats) -> Ints:
    """Return the nearest centroid of each point; exact ties go to the lowest index.

    Distances are sums of squared differences, evaluated alike for every point, so that the answer
    for a point does not depend on the points it is asked together with.

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


def _plus_plus(points: Floats, cells: int, rng: np.random.Generator) -> Floats:
    """Draw (cells, d) seeds among (n, d) points, likelier far from the ones before."""
    columns = np.ascontiguousarray(points.T)
    seeds = np.empty((cells, points.shape[1]))
    nearest = np.full(len(points), np.inf)
    chosen = int(rng.integers(len(points)))
    for cell in range(cells):
        seeds[cell] = points[chosen]
        distance = np.zeros(len(points))
        for column, value in zip(columns, seeds[cell], strict=True):
            difference = column - value
            difference *= difference
            distance += difference
        np.minimum(nearest, distance, out=nearest)
        cumulative = np.cumsum(nearest)
        draw = rng.random() * cumulative[-1]
        chosen = min(int(np.searchsorted(cumulative, draw, side="right")), len(points) - 1)
    return seeds


def _lloyd(points: Floats, seeds: Floats) -> Floats:
    """Move (cells, d) seeds to the means of their samples until their cells settle."""
    cells = len(seeds)
    columns = np.ascontiguousarray(points.T)
    centroids = seeds.copy()
    labels, second = _two_nearest(points, centroids)
    for _ in range(MAX_ITERATIONS):
        counts = np.bincount(labels, minlength=cells)
        sums = np.stack(
            [np.bincount(labels, column, minlength=cells) for column in columns], axis=1
        )
        means = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], centroids)
        # No other centroid came nearer to a sample than the farthest that any of them moved.
        second -= np.sqrt(((means - centroids) ** 2).sum(axis=1).max())
        centroids = means
        own = np.sqrt(((points - centroids[labels]) ** 2).sum(axis=1))
        doubtful = np.flatnonzero(own + _ROUNDING >= second)
        moved, second[doubtful] = _two_nearest(points[doubtful], centroids)
        changes = np.count_nonzero(moved != labels[doubtful])
        labels[doubtful] = moved
        if changes <= SETTLED * len(points):
            break
    return centroids


def _two_nearest(points: Floats, centroids: Floats) -> tuple[Ints, Floats]:
    """Return each point's nearest centroid and its distance to the second nearest, (n,) each."""
    homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    # x.c - |c|^2 / 2 is greatest where |x - c| is least, and takes one matrix product per block.
    weights = np.concatenate([centroids.T, -0.5 * (centroids**2).sum(axis=1)[None]])
    labels = np.empty(len(points), np.int64)
    second = np.empty(len(points))
    block = max(1, _BLOCK_PRODUCTS // weights.size)
    for start in range(0, len(points), block):
        stop = start + block
        score = homogeneous[start:stop] @ weights
        best = score.argmax(axis=1)
        labels[start:stop] = best
        score[np.arange(len(best)), best] = -np.inf
        second[start:stop] = score.max(axis=1)
    squared = (points**2).sum(axis=1) - 2.0 * second
    return labels, np.sqrt(np.maximum(squared, 0.0))
