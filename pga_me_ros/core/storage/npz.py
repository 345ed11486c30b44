"""A repertoire as named NumPy arrays in an ``.npz`` file, which needs only NumPy to load.

docs/export.md lists the arrays. Nothing in such a file is pickled.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.files import save_bytes
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import StorageError

Arrays = dict[str, NDArray[Any]]

FORMAT = "pga_me_ros repertoire 1"
"""First word of the array ``format`` and version of the layout."""

LAYOUT = "for each layer: weight (out, in) row by row, then bias (out)"

_TASK = (
    "observation_names",
    "observation_units",
    "action_names",
    "action_units",
    "action_low",
    "action_high",
    "descriptor_names",
    "descriptor_low",
    "descriptor_high",
)


def repertoire_arrays(info: RunInfo, archive: Archive, cells: Sequence[int]) -> Arrays:
    """Return elites of a repertoire as arrays, one row per elite.

    Args:
        info: Description of the run.
        archive: Its archive.
        cells: The n filled cells whose elites are returned.

    Returns:
        Arrays by name as docs/export.md lists them.
    """
    rows = np.asarray(cells, np.int64)
    task = info.task
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "run_id": np.array(info.run_id),
        "task": np.array(task["name"]),
        "cell": rows,
        "fitness": archive.fitness[rows],
        "descriptor": archive.descriptors[rows],
        "parameters": archive.parameters[rows],
        "evaluation": archive.evaluations[rows],
        "generation": archive.generations[rows],
        "made_by": operator_names(archive.operators[rows]),
        "parents": archive.parents[rows],
        "steps": archive.steps[rows],
        "terminated": archive.terminated[rows],
        "layer_sizes": np.array(info.layer_sizes, np.int64),
        "activations": np.array(info.activations),
        "layout": np.array(LAYOUT),
        "control_period": np.array(task["control_period"], np.float64),
        "archive": np.array(archive.kind),
        "bins": np.array(archive.bins, np.int64),
        "centroids": archive.centroids,
    }
    return arrays | {name: np.array(task[name]) for name in _TASK}


def operator_names(operators: Int64Array) -> NDArray[np.str_]:
    """Return the names of operators, for example ``pg`` (`Operator.label`)."""
    return np.array([Operator(o).label for o in operators.tolist()], dtype=np.str_)


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays into a file, replacing it atomically.

    Equal arrays give equal bytes.

    Raises:
        StorageError: The file cannot be written.
    """
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    save_bytes(path, buffer.getvalue())


def load_arrays(path: Path, required: str, what: str) -> Arrays:
    """Read a file of arrays.

    Args:
        path: The file.
        required: Required value of its array ``format``.
        what: Name of this kind of file, for messages.

    Raises:
        StorageError: The file is missing, damaged or of another kind.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise StorageError(f"There is no {what} '{path}'; check the path.") from None
    except OSError as error:
        raise StorageError(f"'{path}' cannot be read ({error.strerror or error}).") from None
    except (
        zipfile.BadZipFile,
        zlib.error,
        ValueError,
        EOFError,
        TypeError,  # a single array
        RuntimeError,  # an encrypted or otherwise packed zip file
        KeyError,
    ):  # their words advise to allow pickles, or tell what is inside of a zip file
        raise StorageError(
            f"'{path}' is damaged or no {what}; restore it or write it again."
        ) from None
    if str(arrays.get("format", "")) != required:
        raise StorageError(
            f"'{path}' is no {what}: its array 'format' is {str(arrays.get('format', 'missing'))!r}, expected "
            f"{required!r}."
        )
    return arrays
