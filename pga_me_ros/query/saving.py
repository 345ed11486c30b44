"""A behavior that was asked for as a file: an ONNX model, TorchScript, or NumPy arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.client import Behavior, RepertoireInfo
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.files import save_bytes
from pga_me_ros.core.storage.npz import FORMAT, LAYOUT, save_arrays
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.convert import PURE_NUMBER

ENDINGS = (".onnx", ".npz", ".pt")

_LIMITED = ("action", "observation", "joint")


def require_savable(path: Path) -> None:
    """Make sure, before anything is asked for, that a behavior can be saved under a name.

    Raises:
        RequestError: The name ends in something else.
        PgaError: The onnx or torch package is not installed, but the name asks for it.
    """
    if path.suffix not in ENDINGS:
        raise RequestError(f"--save is '{path}'; give a name that ends in {', '.join(ENDINGS)}.")
    if path.suffix == ".onnx":
        from pga_me_ros.export.onnx_model import require_onnx

        require_onnx()
    if path.suffix == ".pt":
        from pga_me_ros.export.torchscript import require_torch

        require_torch()


def save(behavior: Behavior, info: RepertoireInfo, path: Path) -> None:
    """Save a behavior with its controller, in the form that `export` has for one elite; docs/export.md describes it.

    Args:
        behavior: The behavior.
        info: Repertoire that it comes from.
        path: File to write, see `require_savable`.

    Raises:
        StorageError: The file cannot be written.
    """
    if path.suffix == ".npz":
        save_arrays(path, _arrays(behavior, info))
        return
    if path.suffix == ".pt":
        from pga_me_ros.export.torchscript import scripted_bytes as as_bytes
    else:
        from pga_me_ros.export.onnx_model import controller_bytes as as_bytes

    controller = behavior.controller
    shape = MlpShape(controller.layer_sizes)
    save_bytes(path, as_bytes(shape, controller.parameters, _about(behavior, info)))


def _about(behavior: Behavior, info: RepertoireInfo) -> dict[str, str]:
    """Return what a controller's user must know, as text by name; lists and numbers are JSON."""
    from pga_me_ros.export.source import OF_ROBOT, about_behavior, described

    controller = behavior.controller
    own = {
        "observation_units": _units(controller.observation_units),
        "action_units": _units(controller.action_units),
        **{f"{kind}_low": getattr(controller, f"{kind}_low").tolist() for kind in _LIMITED},
        **{f"{kind}_high": getattr(controller, f"{kind}_high").tolist() for kind in _LIMITED},
    }
    robot = {name: own.get(name, getattr(controller, name)) for name in OF_ROBOT}
    known = {"descriptor_names": info.descriptor_names, **robot}
    return described(controller.task, info.run_id, known) | about_behavior(
        behavior, controller.layer_sizes
    )


def _units(units: Sequence[str]) -> list[str]:
    """Return units as tasks and files have them, where a pure number has none."""
    return ["" if unit == PURE_NUMBER else unit for unit in units]


def _arrays(behavior: Behavior, info: RepertoireInfo) -> dict[str, NDArray[Any]]:
    """Return the arrays of an exported repertoire of one behavior, but for those that describe the archive's cells."""
    controller, d = behavior.controller, len(behavior.descriptor)
    parents = [*behavior.parents, -1, -1][:2]
    arrays = {
        "format": np.array(FORMAT),
        "run_id": np.array(info.run_id),
        "task": np.array(controller.task),
        "cell": np.array([behavior.cell], np.int64),
        "fitness": np.array([behavior.fitness]),
        "descriptor": behavior.descriptor[None],
        "parameters": controller.parameters[None],
        "evaluation": np.array([behavior.evaluation], np.int64),
        "generation": np.array([behavior.generation], np.int64),
        "made_by": np.array([behavior.made_by]),
        "parents": np.array([parents], np.int64),
        "steps": np.array([behavior.steps], np.int64),
        "terminated": np.array([behavior.terminated]),
        "layer_sizes": np.array(controller.layer_sizes, np.int64),
        "activations": np.array(["relu"] * (len(controller.layer_sizes) - 2) + ["tanh"]),
        "layout": np.array(LAYOUT),
        "control_period": np.array(controller.control_period),
        "archive": np.array(info.archive),
        "action_low": controller.action_low,
        "action_high": controller.action_high,
        "descriptor_names": np.array(info.descriptor_names),
        "descriptor_low": info.descriptor_low,
        "descriptor_high": info.descriptor_high,
    }
    for kind in ("observation", "action"):
        arrays[f"{kind}_names"] = np.array(getattr(controller, f"{kind}_names"))
        arrays[f"{kind}_units"] = np.array(_units(getattr(controller, f"{kind}_units")))
    if behavior.repeats:
        spread = behavior.descriptor_spread if behavior.repeats > 1 else np.full(d, math.nan)
        arrays["repeats"] = np.array([behavior.repeats], np.int64)
        arrays["mean_fitness"] = np.array([behavior.mean_fitness])
        arrays["fitness_spread"] = np.array([behavior.fitness_spread])
        arrays["fall_share"] = np.array([behavior.fall_share])
        arrays["mean_descriptor"] = behavior.mean_descriptor[None]
        arrays["descriptor_spread"] = spread[None]
    return arrays
