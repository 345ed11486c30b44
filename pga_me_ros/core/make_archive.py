"""The empty archive that a task and the settings ask for."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive import Archive, CvtArchive, GridArchive
from pga_me_ros.core.cvt import cvt_centroids
from pga_me_ros.core.policy import controller_shape
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.spec import TaskSpec

CENTROIDS_SEED = 0
"""All runs share their centroids, so that their archives can be compared cell by cell (as coded)."""


def cell_count(spec: TaskSpec, settings: Settings) -> int:
    """Return the number of cells of a run's archive."""
    if settings.archive == "grid":
        return math.prod(spec.archive_bins)
    return settings.cells or spec.archive_cells


def make_archive(spec: TaskSpec, settings: Settings) -> Archive:
    """Return an empty archive (Alg. 3 line 2).

    Args:
        spec: Task; gives bounds, and cells or bins where the settings leave them open.
        settings: Settings of the run.

    Raises:
        ArchiveError: Fewer `cvt_samples` than cells.
    """
    count = controller_shape(spec, settings).parameter_count
    if settings.archive == "grid":
        return GridArchive(spec.archive_bins, spec.descriptor_low, spec.descriptor_high, count)
    bounds = tuple(spec.descriptor_low), tuple(spec.descriptor_high)
    centroids = _centroids(cell_count(spec, settings), *bounds, settings.cvt_samples)
    return CvtArchive(centroids, spec.descriptor_low, spec.descriptor_high, count)


@lru_cache(maxsize=2)
def _centroids(
    cells: int, low: tuple[float, ...], high: tuple[float, ...], samples: int
) -> NDArray[np.float64]:
    """Return centroids that the caller copies; some ask for them more than once, and they take seconds."""
    rng = generator(CENTROIDS_SEED, Purpose.CENTROIDS, 0, cells)
    return cvt_centroids(cells, low, high, samples, rng)
