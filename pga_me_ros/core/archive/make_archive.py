"""The kinds of archive: what settings and files call them, and how each is made. No other file depends on the kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive, cvt_centroids
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.spec import TaskSpec

CENTROIDS_SEED = 0
"""All runs share their centroids, so that archives can be compared cell by cell, as in the authors' code."""

LEAST_SAMPLES = 10_000
SAMPLES_PER_CELL = 250
"""Uniform samples that the cells of a thinned archive are computed from: so many per cell, but at least those."""


@dataclass(frozen=True)
class ArchiveKind:
    """How archives of one kind are made.

    Attributes:
        cells: Returns the number of cells for a task and settings.
        empty: Returns an empty archive for a task, settings and a number of parameters per controller.
        restored: Returns an empty archive from its stored geometry (kind, bins, low, high, parameter_count), its
            (cells, d) float64 centroids and the version of the file's layout.
    """

    cells: Callable[[TaskSpec, Settings], int]
    empty: Callable[[TaskSpec, Settings, int], Archive]
    restored: Callable[[Mapping[str, Any], Float64Array, int], Archive]


def cell_count(spec: TaskSpec, settings: Settings) -> int:
    """Return the number of cells of a run's archive."""
    return ARCHIVES[settings.archive].cells(spec, settings)


def make_archive(spec: TaskSpec, settings: Settings) -> Archive:
    """Return an empty archive (Alg. 3 line 2).

    Args:
        spec: Task; gives bounds, and cells or bins if the settings do not.
        settings: Settings of the run.

    Raises:
        ArchiveError: Fewer `cvt_samples` than cells.
    """
    count = controller_shape(spec, settings).parameter_count
    return ARCHIVES[settings.archive].empty(spec, settings, count)


def restore_archive(
    geometry: Mapping[str, Any], centroids: Float64Array, schema_version: int
) -> Archive:
    """Return the empty archive that a repertoire file describes, see `ArchiveKind.restored`."""
    return ARCHIVES[geometry["kind"]].restored(geometry, centroids, schema_version)


def cvt_archive(
    cells: int, low: Sequence[float], high: Sequence[float], samples: int, parameter_count: int
) -> CvtArchive:
    """Return an empty CVT archive with the centroids that all runs share.

    Args:
        cells: Number of cells.
        low: Lower bound of each of the d descriptor dimensions.
        high: Upper bounds.
        samples: Uniform samples that its cells are computed from.
        parameter_count: Number of parameters of a controller.

    Raises:
        ArchiveError: Fewer samples than cells.
    """
    centroids = _centroids(cells, tuple(low), tuple(high), samples)
    return CvtArchive(centroids, low, high, parameter_count)


def thinned_archive(
    cells: int, low: Sequence[float], high: Sequence[float], parameter_count: int
) -> CvtArchive:
    """Return the empty archive of so many cells to which `thin` reduces any archive; arguments as in `cvt_archive`."""
    samples = max(LEAST_SAMPLES, SAMPLES_PER_CELL * cells)
    return cvt_archive(cells, low, high, samples, parameter_count)


def _cvt(spec: TaskSpec, settings: Settings, parameter_count: int) -> Archive:
    return cvt_archive(
        cell_count(spec, settings),
        spec.descriptor_low,
        spec.descriptor_high,
        settings.cvt_samples,
        parameter_count,
    )


def _restored_cvt(
    geometry: Mapping[str, Any], centroids: Float64Array, schema_version: int
) -> Archive:
    low, high, count = geometry["low"], geometry["high"], geometry["parameter_count"]
    return CvtArchive(centroids, low, high, count, scaled=schema_version > 1)


@lru_cache(maxsize=2)
def _centroids(
    cells: int, low: tuple[float, ...], high: tuple[float, ...], samples: int
) -> Float64Array:
    """Return centroids, which the caller must copy; cached, as they take seconds and may be needed more than once."""
    rng = generator(CENTROIDS_SEED, Purpose.CENTROIDS, 0, cells)
    return cvt_centroids(cells, low, high, samples, rng)


def _grid(spec: TaskSpec, settings: Settings, parameter_count: int) -> Archive:
    return GridArchive(
        spec.archive_bins, spec.descriptor_low, spec.descriptor_high, parameter_count
    )


def _restored_grid(
    geometry: Mapping[str, Any], centroids: Float64Array, schema_version: int
) -> Archive:
    return GridArchive(
        geometry["bins"], geometry["low"], geometry["high"], geometry["parameter_count"]
    )


ARCHIVES: Mapping[str, ArchiveKind] = {
    CvtArchive.kind: ArchiveKind(
        lambda spec, settings: settings.cells or spec.archive_cells, _cvt, _restored_cvt
    ),
    GridArchive.kind: ArchiveKind(
        lambda spec, settings: math.prod(spec.archive_bins), _grid, _restored_grid
    ),
}
"""All kinds, by the value of the setting `archive`."""
