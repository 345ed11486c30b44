"""The actor of a thinned repertoire: a small file of its own, because `thin` leaves the critics' checkpoints behind.

docs/export.md lists its arrays; it needs only NumPy to load.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.npz import LAYOUT, load_arrays, save_arrays
from pga_me_ros.errors import NetworkError, StorageError
from pga_me_ros.tasks.spec import TaskSpec

FILE = "actor.npz"
"""Name of the file in the folder of the repertoire."""

FORMAT = "pga_me_ros actor 1"

_OF_TASK = (
    "observation_names",
    "action_names",
    *(f"descriptor_{w}" for w in ("names", "low", "high")),
)


def save_actor(
    repertoire: Path, run_id: str, spec: TaskSpec, actor: ConditionedActor, generation: int
) -> None:
    """Write an actor next to a repertoire file, in place of an earlier one.

    Args:
        repertoire: The repertoire file.
        run_id: Its run.
        spec: Its task.
        actor: The actor.
        generation: Generation for whose offspring it was trained.

    Raises:
        StorageError: The file cannot be written.
    """
    arrays: dict[str, Any] = {
        "format": FORMAT,
        "run_id": run_id,
        "task": spec.name,
        "generation": np.int64(generation),
        "layer_sizes": np.array(actor.shape.sizes, np.int64),
        "layout": LAYOUT,
        "parameters": actor.parameters,
        **{name: getattr(spec, name) for name in _OF_TASK},
    }
    save_arrays(repertoire.with_name(FILE), {name: np.array(v) for name, v in arrays.items()})


def load_actor(repertoire: Path, run_id: str, spec: TaskSpec) -> tuple[ConditionedActor, int]:
    """Read the actor next to a repertoire file.

    Args:
        repertoire: The repertoire file.
        run_id: Its run.
        spec: Its task.

    Returns:
        The actor, and the generation for whose offspring it was trained.

    Raises:
        StorageError: The file is missing, damaged, or of another run.
    """
    path = repertoire.with_name(FILE)
    arrays = load_arrays(path, FORMAT, "file of an actor")
    if str(arrays.get("run_id", "")) != run_id:
        raise StorageError(
            f"'{path}' is of run {arrays.get('run_id', 'unknown')}, but the repertoire next to it is of run {run_id}; "
            "move the file away, or thin the run again."
        )
    try:
        shape = MlpShape(tuple(arrays["layer_sizes"].tolist()))
        return ConditionedActor(spec, shape, arrays["parameters"]), int(arrays["generation"])
    except (KeyError, TypeError, NetworkError) as error:
        raise StorageError(
            f"'{path}' holds no actor of this repertoire ({error}); thin the run again."
        ) from None
