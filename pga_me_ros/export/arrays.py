"""Exports as NumPy arrays: a complete repertoire, or the arguments of a pyribs archive."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pga_me_ros.core.storage.npz import save_arrays
from pga_me_ros.export.source import Source


def write_npz(source: Source, path: Path) -> None:
    """Write the elites with everything known about them; docs/export.md lists the arrays.

    Raises:
        StorageError: The file cannot be written.
    """
    save_arrays(path, source.run.arrays(source.cells))


def write_pyribs(source: Source, path: Path) -> None:
    """Write the arguments of ``ribs.archives.CVTArchive`` or ``GridArchive`` and their ``add``, by name.

    For a CVT archive, measures, centroids and ranges are in the coordinates that decide on the cell: shares of the
    descriptor's range.

    Raises:
        StorageError: The file cannot be written.
    """
    archive, rows = source.run.archive, np.array(source.cells)
    bounds = np.stack([archive.low, archive.high])
    if archive.bins:
        cells = {"dims": np.array(archive.bins)}
        measures = archive.descriptors[rows]
    else:  # pyribs assigns cells by plain distances
        cells = {"centroids": archive.coordinates(archive.centroids)}
        measures, bounds = (
            archive.coordinates(archive.descriptors[rows]),
            archive.coordinates(bounds),
        )
    arrays = {
        "solution": archive.parameters[rows],
        "objective": archive.fitness[rows],
        "measures": measures,
        "ranges": bounds.T.copy(),
        "measure_names": np.array(source.run.spec.descriptor_names),
    }
    save_arrays(path, cells | arrays)
