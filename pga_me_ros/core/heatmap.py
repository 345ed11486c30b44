"""Pictures of an archive: fitness by cell, as in Figure 4 of Nilsson & Cully 2021."""

from __future__ import annotations

import math
import struct
import zlib
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.cvt import nearest_centroids
from pga_me_ros.core.errors import ArchiveError

Image = NDArray[np.uint8]

EMPTY = (225, 225, 225)
LINE = (255, 255, 255)
ANCHORS = ((40, 12, 84), (52, 74, 140), (30, 130, 140), (70, 184, 108), (250, 232, 60))
"""Colours from the least to the greatest fitness; ever brighter, so that they also work in grey."""

_SUB_COLUMNS = 4


def render(
    archive: Archive,
    width: int = 480,
    low: float | None = None,
    high: float | None = None,
) -> Image:
    """Return a fitness heatmap; grey cells are empty.

    Two dimensions: the first descriptor grows from left to right, the second from bottom to top.
    More: maps within a map, the first two dimensions outermost; a CVT archive's elites are then
    binned. One: columns.

    Args:
        archive: Archive to show.
        width: Pixels from left to right.
        low: Fitness of the darkest colour, None for the least in the archive.
        high: Fitness of the brightest colour, None for the greatest.

    Returns:
        (h, w, 3) uint8 RGB image, top row first; w is `width`, or a little less where bins are
        whole pixels.

    Raises:
        ArchiveError: There are fewer pixels than bins.
    """
    if width < 1:
        raise ArchiveError(f"width is {width}; give at least one pixel.")
    if archive.dimensions == 1 and not archive.bins:
        values = _columns(archive, width)
    elif archive.dimensions == 2 and not archive.bins:
        box = archive.low.tobytes() + archive.high.tobytes()
        values = archive.fitness[_voronoi_pixels(box, archive.centroids.tobytes(), width)]
    else:
        return _nested(archive, width, low, high)
    return _colours(values, archive, low, high)


def write_png(path: str | Path, rgb: Image) -> None:
    """Write an image as a PNG file.

    Args:
        path: The file, overwritten.
        rgb: (h, w, 3) uint8 image, top row first.

    Raises:
        OSError: It cannot be written.
    """
    height, width, _ = rgb.shape
    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = rgb.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows.tobytes(), 9))
    Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + body + _chunk(b"IEND", b""))


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(kind + data)
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)


@lru_cache(maxsize=4)
def _voronoi_pixels(box: bytes, centroids: bytes, width: int) -> NDArray[np.int64]:
    """Return the cell at the centre of each pixel of a square picture, top row first.

    Takes arrays as bytes and is remembered: an archive is shown many times, its cells never move.
    """
    low, high = np.frombuffer(box).reshape(2, 2)
    share = (np.arange(width)[:, None] + 0.5) / width
    x, y = (low + share * (high - low)).T
    points = np.stack([np.tile(x, width), np.repeat(y[::-1], width)], axis=1)
    return nearest_centroids(points, np.frombuffer(centroids).reshape(-1, 2)).reshape(width, width)


def _columns(archive: Archive, width: int) -> NDArray[np.float64]:
    """Return per pixel the greatest fitness of the cells in its column, NaN for none."""
    per_column = max(_SUB_COLUMNS, math.ceil(_SUB_COLUMNS * archive.cells / width))
    share = (np.arange(width * per_column) + 0.5) / (width * per_column)
    points = archive.low + share[:, None] * (archive.high - archive.low)
    fitness = archive.fitness[nearest_centroids(points, archive.centroids)]
    columns = np.where(np.isnan(fitness), -np.inf, fitness).reshape(width, per_column).max(axis=1)
    columns[np.isinf(columns)] = np.nan
    return np.tile(columns, (max(1, width // 4), 1))


def _nested(archive: Archive, width: int, low: float | None, high: float | None) -> Image:
    """Return bins within bins: dimensions 0, 2, 4... to the right, 1, 3, 5... upwards."""
    even = round(archive.cells ** (1.0 / archive.dimensions))
    bins = archive.bins or (even,) * archive.dimensions
    values = np.full(bins, -np.inf)
    filled = archive.filled_cells()
    if archive.bins:
        where = np.unravel_index(filled, bins)
    else:
        share = (archive.descriptors[filled] - archive.low) / (archive.high - archive.low)
        limits = np.array(bins)
        where = tuple(np.clip((share * limits).astype(np.int64), 0, limits - 1).T)
    np.maximum.at(values, where, archive.fitness[filled])
    values[np.isinf(values)] = np.nan
    across, up = bins[0::2], bins[1::2]
    order = (*range(1, len(bins), 2), *range(0, len(bins), 2))
    table = values.transpose(order).reshape(math.prod(up), math.prod(across))[::-1]
    scale = width // table.shape[1]
    if scale < 1:
        raise ArchiveError(f"width is {width}; {table.shape[1]} bins need as many pixels.")
    tall = scale if up else max(1, width // 4)
    image = _colours(np.repeat(np.repeat(table, tall, 0), scale, 1), archive, low, high)
    if len(bins) > 2 and scale > 2:
        image[:: tall * math.prod(up[1:])] = LINE
        image[:, :: scale * math.prod(across[1:])] = LINE
    return image


def _colours(
    values: NDArray[np.float64], archive: Archive, low: float | None, high: float | None
) -> Image:
    """Return (h, w) fitness values, NaN for empty cells, as (h, w, 3) colours."""
    fitness = archive.fitness[archive.filled]
    least = low if low is not None else float(fitness.min(initial=math.inf))
    most = high if high is not None else float(fitness.max(initial=-math.inf))
    empty = np.isnan(values)
    span = most - least
    share = (values - least) / span if 0 < span < math.inf else np.ones_like(values)
    share = np.where(empty, 0.0, np.clip(share, 0.0, 1.0))
    stops = np.linspace(0.0, 1.0, len(ANCHORS))
    channels = [np.interp(share, stops, channel) for channel in np.array(ANCHORS, float).T]
    image = np.round(np.stack(channels, axis=-1)).astype(np.uint8)
    image[empty] = EMPTY
    return image
