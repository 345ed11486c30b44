"""The empty archive that a task and the settings ask for."""

from __future__ import annotations

from pga_me_ros.core.archive import Archive, CvtArchive, GridArchive
from pga_me_ros.core.cvt import cvt_centroids
from pga_me_ros.core.policy import controller_shape
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.spec import TaskSpec

CENTROIDS_SEED = 0
"""All runs share their centroids, so that their archives can be compared cell by cell (as coded)."""


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
    cells = settings.cells or spec.archive_cells
    rng = generator(CENTROIDS_SEED, Purpose.CENTROIDS, 0, cells)
    centroids = cvt_centroids(
        cells, spec.descriptor_low, spec.descriptor_high, settings.cvt_samples, rng
    )
    return CvtArchive(centroids, spec.descriptor_low, spec.descriptor_high, count)
