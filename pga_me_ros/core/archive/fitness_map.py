"""A two-dimensional archive as a map of square cells, for tools that show maps."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.color_range import color_range
from pga_me_ros.core.archive.geometry import nearest_centroids_on_raster
from pga_me_ros.errors import ArchiveError

OUTSIDE = -1
"""Cell of a square whose center lies outside the descriptor space."""

EMPTY = -1
"""Value where there is no elite."""

MOST_BINS = 1000
"""Maximum bins along a side for which each is a square of its own; tools get slow with larger maps."""

BEST = 100
"""Value of the best elite; the worst one has 0."""


class FitnessMap:
    """Maps the squares of a picture to descriptor space, and an archive's fitness to the squares.

    The map begins at the lower bounds of the descriptor and covers the whole space. If the bins of a grid archive are
    squares, and no side has more than `MOST_BINS`, the map uses them. Otherwise, a square shows the archive's cell at
    its center, as the heatmap does.

    Args:
        archive: Archive whose cells are shown; its elites do not matter.
        longest: Squares along the longer side if squares are not bins.

    Attributes:
        resolution: Side of a square, in descriptor units.
        columns: Squares along the first descriptor.
        rows: Squares along the second.

    Raises:
        ArchiveError: The archive does not have two dimensions.
    """

    def __init__(self, archive: Archive, longest: int = 240) -> None:
        if archive.dimensions != 2:
            raise ArchiveError(f"A map has two dimensions; this archive has {archive.dimensions}.")
        self._archive = archive
        extent = archive.high - archive.low
        sides = extent / np.array(archive.bins) if archive.bins else np.zeros(1)
        square = bool(archive.bins) and np.isclose(sides[0], sides[1], rtol=1e-9, atol=0.0)
        if square and max(archive.bins) <= MOST_BINS:
            self.resolution = float(sides[0])
            self.columns, self.rows = archive.bins
        else:
            self.resolution = float(extent.max()) / longest
            # A rounding error must not add a square to a side.
            squares = np.ceil(extent / self.resolution - 1e-9).astype(int)
            self.columns, self.rows = np.maximum(squares, 1).tolist()

    @property
    def origin(self) -> tuple[float, float]:
        """Descriptor at the lower left corner of the first square."""
        first, second = self._archive.low.tolist()
        return first, second

    def values(self, archive: Archive) -> NDArray[np.int8]:
        """Return the fitness on the map.

        Args:
            archive: Archive with the same cells as the first one.

        Returns:
            (rows, columns) int8, the row of the lowest second descriptor first: 0 for the worst elite to 100 for the
            best, outliers apart (`color_range`; 100 for all if they are equally fit), -1 for no elite.
        """
        shown = np.full(archive.cells, EMPTY, np.int8)
        fitness = archive.fitness[archive.filled]
        if len(fitness):
            worst, best = color_range(fitness)
            # Halved first: the difference of two finite numbers may be infinite.
            span = best / 2 - worst / 2
            share = (fitness / 2 - worst / 2) / span if span > 0 else np.ones_like(fitness)
            shown[archive.filled] = np.rint(BEST * np.clip(share, 0.0, 1.0))
        inside = self._cells != OUTSIDE
        return np.where(inside, shown[self._cells], np.int8(EMPTY))

    @cached_property
    def _cells(self) -> Int64Array:
        """(rows, columns) archive cell at the center of each square, `OUTSIDE` of the descriptor space."""
        x, y = (
            np.asarray(low + (np.arange(n) + 0.5) * self.resolution, np.float64)
            for low, n in zip(self.origin, (self.columns, self.rows), strict=True)
        )
        archive = self._archive
        if archive.bins:
            points = np.stack([np.tile(x, self.rows), np.repeat(y, self.columns)], axis=1)
            cells = archive.cell_of(points).reshape(self.rows, self.columns)
        else:
            first, second = archive.low
            across = archive.coordinates(np.stack([x, np.full_like(x, second)], axis=1))[:, 0]
            up = archive.coordinates(np.stack([np.full_like(y, first), y], axis=1))[:, 1]
            centroids = archive.coordinates(archive.centroids)
            cells = nearest_centroids_on_raster(across, up, centroids)
        first, second = archive.high
        cells[:, x > first] = OUTSIDE
        cells[y > second] = OUTSIDE
        return cells
