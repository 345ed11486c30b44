"""Archives whose cells are a centroidal Voronoi tessellation (CVT).

A CVT archive spreads its cells evenly over the behavior space by clustering uniform samples
(section 2.2 of Nilsson & Cully 2021, after Vassiliades et al. 2018): k-means++ seeding, Lloyd's
iterations until hardly any sample changes its cell. The latter skip each sample whose nearest
centroid provably stays the nearest (triangle inequality), which saves time and changes no result.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.geometry import checked_box, nearest_centroids
from pga_me_ros.errors import ArchiveError

MAX_ITERATIONS = 300
SETTLED = 1e-3
"""Share of samples that may still change their cell at the end: 0.2 % above the converged error."""
_BLOCK_PRODUCTS = 1 << 18
"""Multiplications per matrix product: few enough that BLAS starts no threads. On a loaded machine they
would mostly wait for each other, and they could change the sums."""
_ROUNDING = 1e-7
"""Slack on the unit box: far above the rounding of a distance, far below the size of a cell."""


def cvt_centroids(
    cells: int,
    low: Sequence[float],
    high: Sequence[float],
    samples: int,
    rng: np.random.Generator,
) -> Float64Array:
    """Return centroids of a centroidal Voronoi tessellation of a box.

    Args:
        cells: Number of cells, at most `samples`.
        low: Lower bound of each of the d descriptor dimensions.
        high: Upper bounds.
        samples: Number of uniform samples that are clustered.
        rng: Generator of samples and seeding. Runs share their centroids if it does not depend on
            the run's seed.

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


def _plus_plus(points: Float64Array, cells: int, rng: np.random.Generator) -> Float64Array:
    """Draw (cells, d) seeds among (n, d) points, preferring those far from earlier seeds."""
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


def _lloyd(points: Float64Array, seeds: Float64Array) -> Float64Array:
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
        # No other centroid came nearer to a sample by more than the longest move among them.
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


def _two_nearest(points: Float64Array, centroids: Float64Array) -> tuple[Int64Array, Float64Array]:
    """Return each point's nearest centroid and its distance to the second nearest, (n,) each."""
    homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    # x.c - |c|^2 / 2 is largest where |x - c| is smallest, and takes one matrix product per block.
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


class CvtArchive(Archive):
    """Cells of a centroidal Voronoi tessellation: a descriptor belongs to the nearest centroid.

    Distances are Euclidean, with each dimension in shares of its range, as in the tessellation itself. Ties go to the
    lowest index. The authors use this archive; `cvt_centroids` makes its centroids.

    Args:
        centroids: (cells, d) float64 centers of the cells, in the descriptor's units.
        low: Lower bound of each of the d descriptor dimensions.
        high: Upper bounds.
        parameter_count: Number P of parameters of a controller.
        scaled: False for files of schema version 1, which measure distances to centroids in the descriptor's units.

    Raises:
        ArchiveError: Centroids, bounds or the parameter count do not fit together.
    """

    kind = "cvt"

    def __init__(
        self,
        centroids: ArrayLike,
        low: Sequence[float],
        high: Sequence[float],
        parameter_count: int,
        *,
        scaled: bool = True,
    ) -> None:
        """Make an empty archive."""
        super().__init__(centroids, low, high, parameter_count)
        # In the unit box, both give the same bits.
        self.scaled = scaled or not (self.low.any() or (self.high != 1.0).any())
        self._places = self.coordinates(self.centroids)

    @property
    def note(self) -> str:
        """What users of a stored archive should know about its cells; empty if there is nothing to say."""
        if self.scaled:
            return ""
        return (
            "this repertoire was begun by an older version, which measured distances to the centers of cells in the "
            "descriptor's units; it keeps these cells. All other distances are in shares of the descriptor's range."
        )

    def coordinates(self, descriptors: Float64Array) -> Float64Array:
        """Return (n, d) descriptors in the coordinates in which distances to centroids are measured."""
        return super().coordinates(descriptors) if self.scaled else descriptors

    def _nearest_cells(self, descriptors: Float64Array) -> Int64Array:
        return nearest_centroids(self.coordinates(descriptors), self._places)
