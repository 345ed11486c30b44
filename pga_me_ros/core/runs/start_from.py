"""Controllers of existing repertoires with which a run starts, instead of random ones.

They are evaluated as the run's first solutions, with its own seed, for its own archive and experience; their earlier
fitness does not count. The run keeps a copy of them, so that resuming does not depend on their source; their digest is
part of its identity.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.npz import FORMAT, load_arrays, save_arrays
from pga_me_ros.core.storage.stored_run import StoredRun, is_exported, repertoire_file
from pga_me_ros.core.variation.imported_controllers import Controllers, identity, starting_with
from pga_me_ros.errors import SettingsError, StorageError
from pga_me_ros.paths import listed_paths
from pga_me_ros.tasks.spec import TaskSpec

COPY = "start_from.npz"
"""Name of the run's own copy in its folder."""

COPY_FORMAT = "pga_me_ros controllers to start from 1"

_SAME = ("observation_names", "observation_units", "action_names", "action_units")
"""What must be equal for a controller to mean the same in another run."""


def read_controllers(path: Path, spec: TaskSpec, shape: MlpShape) -> Controllers:
    """Read the controllers of a run or of an ``.npz`` file that ``export`` wrote.

    Args:
        path: Folder of a run, its repertoire file, or the exported file.
        spec: Task that they will be used for.
        shape: Layers that they must have.

    Returns:
        (n, P) float32, in the order of their cells.

    Raises:
        StorageError: The file is missing, damaged or of another kind, or its controllers have another task or other
            layers.
    """
    file = repertoire_file(path)
    if is_exported(file):
        about, parameters = _from_npz(file)
    else:
        about, parameters = _from_repertoire(file)
    _require_same_robot(file, about, spec)
    sizes = tuple(about["layer_sizes"])
    if sizes != shape.sizes:
        raise StorageError(
            f"The controllers of '{file}' have layers {list(sizes)}, but this run's have {list(shape.sizes)}; start it "
            f"with controller_hidden:={list(sizes[1:-1])}."
        )
    return _checked(file, parameters, shape)


def with_controllers(
    folder: Path, spec: TaskSpec, settings: Settings, *, new: bool
) -> tuple[Settings, Controllers]:
    """Return the controllers that a run starts from, and its settings with them; a new run keeps a copy of them.

    Args:
        folder: Folder of the run.
        spec: Its task.
        settings: Its settings as given now.
        new: Whether the run is yet to be created.

    Returns:
        The settings as the run stores them (`starting_with`), and (n, P) float32 controllers, one source after the
        other; n = 0 if the settings name none.

    Raises:
        SettingsError: A source is named twice, or as for `listed_paths`.
        StorageError: As for `read_controllers`; also if the copy is damaged or cannot be written.
    """
    controllers = _taken(folder, spec, settings, new=new)
    return starting_with(settings, controllers), controllers


def _taken(folder: Path, spec: TaskSpec, settings: Settings, *, new: bool) -> Controllers:
    """Return the controllers of the run's own copy, if that is what the settings name, else of their sources."""
    shape = controller_shape(spec, settings)
    if not settings.start_from:
        return np.empty((0, shape.parameter_count), np.float32)
    copy = folder / COPY
    if not new and copy.exists():
        arrays = load_arrays(copy, COPY_FORMAT, "copy of the controllers that the run started from")
        kept = _checked(copy, arrays.get("parameters", np.empty(0)), shape)
        if settings.start_from in (str(arrays.get("source")), identity(kept)):
            return kept
    sources = listed_paths(settings.start_from)
    read = [read_controllers(source, spec, shape) for source in sources]
    _require_different(sources, read)
    controllers = np.concatenate(read)
    if new:
        contents = {"source": np.array(settings.start_from), "parameters": controllers}
        save_arrays(copy, {"format": np.array(COPY_FORMAT), **contents})
    return controllers


def _require_different(sources: Sequence[Path], read: Sequence[Controllers]) -> None:
    for k, later in enumerate(read):
        for source, earlier in zip(sources, read[:k], strict=False):
            if np.array_equal(earlier, later):
                raise SettingsError(
                    f"start_from names the same controllers twice: '{source}' and '{sources[k]}'; leave one of them "
                    "out."
                )


def _from_npz(file: Path) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return description and parameters of an exported file."""
    arrays = load_arrays(file, FORMAT, "exported repertoire (export --to npz)")
    names = ("task", "layer_sizes", "parameters", *_SAME)
    missing = [name for name in names if name not in arrays]
    if missing:
        raise StorageError(f"'{file}' lacks the arrays {', '.join(missing)}; export it again.")
    about: dict[str, Any] = {name: arrays[name].tolist() for name in ("layer_sizes", *_SAME)}
    return about | {"name": str(arrays["task"])}, arrays["parameters"]


def _from_repertoire(file: Path) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return description and parameters of a run's elites."""
    run = StoredRun.load(file)
    about = {**run.info.task, "layer_sizes": run.info.layer_sizes}
    return about, run.archive.parameters[run.archive.filled]


def _require_same_robot(file: Path, about: Mapping[str, Any], spec: TaskSpec) -> None:
    own = json.loads(json.dumps(spec.to_json()))
    if about["name"] != own["name"]:
        raise StorageError(
            f"The controllers of '{file}' are of task '{about['name']}', but this run's task is '{own['name']}'; start "
            "from a repertoire of the same task."
        )
    for name in _SAME:
        if list(about[name]) != own[name]:
            raise StorageError(
                f"The task of '{file}' has other {name.replace('_', ' ')} than this run's, so its controllers mean "
                "something else; start from a repertoire of the same version of the task."
            )


def _checked(file: Path, parameters: NDArray[Any], shape: MlpShape) -> Controllers:
    """Return controllers if a run can start from them.

    Raises:
        StorageError: There are none, or their array has another type or shape or holds a number that is not finite.
    """
    count = shape.parameter_count
    if parameters.dtype != np.float32 or parameters.ndim != 2 or parameters.shape[1] != count:
        raise StorageError(
            f"'{file}': the parameters are {parameters.dtype} of shape {parameters.shape}; expected float32 of "
            f"(controllers, {count})."
        )
    if not len(parameters):
        raise StorageError(f"'{file}' holds no behavior yet; run it for longer first.")
    if not np.isfinite(parameters).all():
        raise StorageError(f"'{file}' holds parameters that are not finite; export it again.")
    return parameters
