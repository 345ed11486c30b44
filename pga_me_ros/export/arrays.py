"""Exports as NumPy arrays: all about a repertoire, or just what a pyribs archive is made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pga_me_ros.core.repertoire_arrays import repertoire_arrays, save_arrays
from pga_me_ros.export.source import Source


def write_npz(source: Source, path: Path) -> None:
    """Write the elites with all that is known of them; docs/export.md lists the arrays.

    Raises:
        StorageError: The file cannot be written.
    """
    arrays = repertoire_arrays(source.info, source.archive, source.cells)
    if source.statistics.repeats.any():
        rows = np.array(source.cells)
        arrays |= {name: values[rows] for name, values in vars(source.statistics).items()}
    save_arrays(path, arrays)


def write_pyribs(source: Source, path: Path) -> None:
    """Write what ``ribs.archives.CVTArchive`` or ``GridArchive`` and their ``add`` take, under their names for it.

    Raises:
        StorageError: The file cannot be written.
    """
    archive, rows = source.archive, np.array(source.cells)
    cells = {"dims": np.array(archive.bins)} if archive.bins else {"centroids": archive.centroids}
    arrays = {
        "solution": archive.parameters[rows],
        "objective": archive.fitness[rows],
        "measures": archive.descriptors[rows],
        "ranges": np.stack([archive.low, archive.high], axis=1),
        "measure_names": np.array(source.spec.descriptor_names),
    }
    save_arrays(path, cells | arrays)
