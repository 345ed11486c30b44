"""Controllers of an existing repertoire that a run begins with, in place of random ones.

They are evaluated as the first solutions of the run, with its own seed, for its own archive and experience: what they
were worth elsewhere does not count. The run keeps a copy of them, so that it does not matter to a resumed run what
became of their source; their digest is part of its identity.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.errors import StorageError
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.repertoire_arrays import FORMAT, load_arrays, save_arrays
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage import Repertoire
from pga_me_ros.tasks.spec import TaskSpec

Controllers = NDArray[np.float32]

COPY = "start_from.npz"
"""Name of the run's own copy in its folder."""

COPY_FORMAT = "pga_me_ros controllers to start from 1"

_SAME = ("observation_names", "observation_units", "action_names", "action_units")
"""What must agree for a controller to mean the same in another run."""

_REPERTOIRE = "repertoire.db"
_ZIP = b"PK"


def read_controllers(path: Path, spec: TaskSpec, shape: MlpShape) -> Controllers:
    """Read the controllers of a run or of an ``.npz`` file that ``export`` wrote.

    Args:
        path: Folder of a run, its repertoire file, or the exported file.
        spec: Task that they are to be used for.
        shape: Layers that they are to have.

    Returns:
        (n, P) float32, in the order of their cells.

    Raises:
        StorageError: There is none, it is damaged or something else, or its controllers are of another task or have
            other layers.
    """
    file = path / _REPERTOIRE if path.is_dir() else path
    if _is_zip(file):
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


def identity(controllers: Controllers) -> str:
    """Return what the run's setting ``start_from`` becomes: ``sha256:`` and a digest, or nothing for none."""
    if not len(controllers):
        return ""
    content = np.ascontiguousarray(controllers, "<f4")
    return f"sha256:{hashlib.sha256(str(content.shape).encode() + content.tobytes()).hexdigest()}"


def starting_with(settings: Settings, controllers: Controllers) -> Settings:
    """Return the settings of a run that starts with given controllers.

    They count among its `random_init` first controllers, which become as many as it takes.
    """
    count = max(settings.random_init, len(controllers))
    return settings.replace(start_from=identity(controllers), random_init=count)


def take_controllers(
    folder: Path, spec: TaskSpec, settings: Settings, shape: MlpShape, *, new: bool
) -> Controllers:
    """Return the controllers that a run's settings ask to start from; a new run keeps a copy of them.

    Args:
        folder: Folder of the run.
        spec: Its task.
        settings: Its settings as given now.
        shape: Layers of its controllers.
        new: Whether the run is only about to be made.

    Returns:
        (n, P) float32, n = 0 where the settings ask for none.

    Raises:
        StorageError: As in `read_controllers`, or the copy is damaged or cannot be written.
    """
    if not settings.start_from:
        return np.empty((0, shape.parameter_count), np.float32)
    copy = folder / COPY
    if not new and copy.exists():
        arrays = load_arrays(copy, COPY_FORMAT, "copy of the controllers that the run started from")
        kept = _checked(copy, arrays.get("parameters", np.empty(0)), shape)
        if settings.start_from in (str(arrays.get("source")), identity(kept)):
            return kept
    controllers = read_controllers(Path(settings.start_from), spec, shape)
    if new:
        contents = {"source": np.array(settings.start_from), "parameters": controllers}
        save_arrays(copy, {"format": np.array(COPY_FORMAT), **contents})
    return controllers


def _is_zip(file: Path) -> bool:
    try:
        with file.open("rb") as content:
            return content.read(len(_ZIP)) == _ZIP
    except OSError:
        return False  # what is wrong with it is told where it is opened as a repertoire


def _from_npz(file: Path) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return description and parameters of an exported file."""
    arrays = load_arrays(file, FORMAT, "exported repertoire (export --to npz)")
    names = ("task", "layer_sizes", "parameters", *_SAME)
    missing = [name for name in names if name not in arrays]
    if missing:
        raise StorageError(f"'{file}' lacks the arrays {', '.join(missing)}; export it anew.")
    about: dict[str, Any] = {name: arrays[name].tolist() for name in ("layer_sizes", *_SAME)}
    return about | {"name": str(arrays["task"])}, arrays["parameters"]


def _from_repertoire(file: Path) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return description and parameters of a run's elites."""
    with Repertoire.open(file, read_only=True) as repertoire:
        info, archive = repertoire.info, repertoire.load_archive()
    return {**info.task, "layer_sizes": info.layer_sizes}, archive.parameters[archive.filled]


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
    """Return controllers if they are some.

    Raises:
        StorageError: There are none, or their array has another type or shape or holds a number that is not finite.
    """
    count = shape.parameter_count
    if parameters.dtype != np.float32 or parameters.ndim != 2 or parameters.shape[1] != count:
        raise StorageError(
            f"'{file}': the parameters are {parameters.dtype} of the shape {parameters.shape}; expected float32 of "
            f"(controllers, {count})."
        )
    if not len(parameters):
        raise StorageError(f"'{file}' holds no controller; run it for longer first.")
    if not np.isfinite(parameters).all():
        raise StorageError(f"'{file}' holds parameters that are not finite; export it anew.")
    return parameters
