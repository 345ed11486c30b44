"""Pictures of an archive: fitness by cell, as in Figure 4 of Nilsson & Cully 2021."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.color_range import color_range
from pga_me_ros.core.archive.geometry import nearest_centroids_of_group, nearest_centroids_on_raster
from pga_me_ros.errors import ArchiveError

Image = NDArray[np.uint8]

EMPTY = (225, 225, 225)
LINE = (255, 255, 255)
ANCHORS = ((40, 12, 84), (52, 74, 140), (30, 130, 140), (70, 184, 108), (250, 232, 60))
"""Colors from the lowest to the highest fitness, from dark to bright, so that they also work in gray."""

_SUB_COLUMNS = 4


def draw_heatmap(
    archive: Archive,
    width: int = 480,
    low: float | None = None,
    high: float | None = None,
) -> Image:
    """Return a fitness heatmap; gray cells are empty.

    With two dimensions, the first descriptor grows from left to right, the second from bottom to top.
    With more, maps are nested, the first two dimensions outermost, and a CVT archive's elites are
    binned. With one, cells are columns. A pixel that several cells share shows the fittest elite.

    Args:
        archive: Archive to show, of any number of cells and dimensions.
        width: Pixels from left to right.
        low: Fitness of the darkest color, None for the lowest in the archive, outliers apart (`color_range`).
        high: Fitness of the brightest color, None for the highest in the same way.

    Returns:
        (h, w, 3) uint8 RGB image, top row first; w and, for two dimensions and more, h are at most
        `width`, less where bins are whole pixels. With one dimension, h is a quarter of `width`.

    Raises:
        ArchiveError: `width` is below 1.
    """
    if width < 1:
        raise ArchiveError(f"width is {width}; give at least one pixel.")
    if archive.dimensions == 1 and not archive.bins:
        values = _columns(archive, width)
    elif archive.dimensions == 2 and not archive.bins:
        box = archive.coordinates(np.stack([archive.low, archive.high])).tobytes()
        centroids = archive.coordinates(archive.centroids).tobytes()
        values = archive.fitness[_voronoi_pixels(box, centroids, width)]
    else:
        return _nested(archive, width, low, high)
    return _colors(values, archive, low, high)


@lru_cache(maxsize=4)
def _voronoi_pixels(box: bytes, centroids: bytes, width: int) -> Int64Array:
    """Return the cell at the center of each pixel of a square picture, top row first.

    The arrays come as bytes so that the result can be cached: an archive is shown many times, and its cells never move.
    """
    low, high = np.frombuffer(box).reshape(2, 2)
    share = (np.arange(width)[:, None] + 0.5) / width
    x, y = (low + share * (high - low)).T
    return nearest_centroids_on_raster(x, y[::-1], np.frombuffer(centroids).reshape(-1, 2))


def _columns(archive: Archive, width: int) -> Float64Array:
    """Return the highest fitness of the cells in each pixel's column, NaN for none."""
    per_column = max(_SUB_COLUMNS, math.ceil(_SUB_COLUMNS * archive.cells / width))
    share = (np.arange(width * per_column) + 0.5) / (width * per_column)
    low, high = archive.coordinates(np.stack([archive.low, archive.high]))
    points = low + share[:, None] * (high - low)
    centroids = archive.coordinates(archive.centroids)
    cells = [
        nearest_centroids_of_group(group, centroids)
        for group in points.reshape(width, per_column, 1)
    ]
    fitness = archive.fitness[np.stack(cells)]
    columns = np.where(np.isnan(fitness), -np.inf, fitness).max(axis=1)
    columns[np.isinf(columns)] = np.nan
    return np.tile(columns, (max(1, width // 4), 1))


def _nested(archive: Archive, width: int, low: float | None, high: float | None) -> Image:
    """Return bins within bins: dimensions 0, 2, 4... to the right, 1, 3, 5... upwards."""
    # At least 2: with many dimensions and few cells, everything would be in one bin.
    even = max(2, round(archive.cells ** (1.0 / archive.dimensions)))
    bins = archive.bins or (even,) * archive.dimensions
    filled = archive.filled_cells()
    if archive.bins:
        where = np.stack(np.unravel_index(filled, bins))
    else:
        share = (archive.descriptors[filled] - archive.low) / (archive.high - archive.low)
        limits = np.array(bins)
        where = np.minimum((np.clip(share, 0.0, 1.0) * limits).astype(np.int64), limits - 1).T
    across = _Axis(bins[0::2], width)
    up = _Axis(bins[1::2], width)
    table = np.full((up.length, across.length), -np.inf)
    places = up.places(where[1::2], len(filled)), across.places(where[0::2], len(filled))
    np.maximum.at(table, places, archive.fitness[filled])
    table[np.isinf(table)] = np.nan
    tall = up.scale if up.bins else max(1, width // 4)
    shown = np.repeat(np.repeat(table[::-1], tall, 0), across.scale, 1)
    image = _colors(shown, archive, low, high)
    if len(bins) > 2 and min(tall, across.scale) > 2:
        image[:: tall * math.prod(up.bins[1:])] = LINE
        image[:, :: across.scale * math.prod(across.bins[1:])] = LINE
    return image


class _Axis:
    """The bins of every other dimension along one side of a picture, those of the first dimension outermost.

    Args:
        bins: Bins of each of these dimensions.
        pixels: Maximum number of pixels.

    Attributes:
        bins: Bins of the dimensions that are shown; the other dimensions lie within one pixel.
        length: Number of places along the side: one per bin, or one per pixel if there are more bins than pixels.
        scale: Pixels per place.
    """

    def __init__(self, bins: Sequence[int], pixels: int) -> None:
        shown = next((n for n in range(len(bins)) if math.prod(bins[:n]) >= pixels), len(bins))
        self.bins = tuple(bins[:shown])
        self._count = math.prod(self.bins)
        self.length = min(self._count, pixels)
        self.scale = pixels // self.length

    def places(self, where: Int64Array, count: int) -> Int64Array:
        """Return the places of some cells.

        Args:
            where: (dimensions of this side, count) bins of the cells.
            count: Number of cells.

        Returns:
            (count,) int64, below `length`.
        """
        place = np.zeros(count, np.int64)
        for index, n in zip(where, self.bins, strict=False):
            place = place * n + index
        return place * self.length // self._count


def _colors(values: Float64Array, archive: Archive, low: float | None, high: float | None) -> Image:
    """Return (h, w) fitness values, NaN for empty cells, as (h, w, 3) colors."""
    darkest, brightest = color_range(archive.fitness[archive.filled])
    least = low if low is not None else darkest
    most = high if high is not None else brightest
    empty = np.isnan(values)
    # Halved first: the difference of two finite numbers may be infinite.
    span = most / 2 - least / 2
    share = (values / 2 - least / 2) / span if 0 < span < math.inf else np.ones_like(values)
    share = np.where(empty, 0.0, np.clip(share, 0.0, 1.0))
    stops = np.linspace(0.0, 1.0, len(ANCHORS))
    channels = [np.interp(share, stops, channel) for channel in np.array(ANCHORS, float).T]
    image = np.round(np.stack(channels, axis=-1)).astype(np.uint8)
    image[empty] = EMPTY
    return image
