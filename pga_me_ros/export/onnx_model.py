"""Export of controllers as ONNX models, built layer by layer. Needs the onnx package, but not torch."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.dependencies import imported
from pga_me_ros.export.source import Source, about_robot

OPSET = 13
"""Old enough for robots, new enough for every operator used here."""

IR_VERSION = 8


def require_onnx() -> ModuleType:
    """Return the onnx package.

    Raises:
        MissingDependencyError: onnx is not installed.
    """
    return imported("onnx", "onnx.helper", "onnx.numpy_helper", purpose="export to ONNX")


def onnx_bytes(source: Source, elite: Elite) -> bytes:
    """Return an elite's controller as a serialised ONNX model, see `controller_bytes`."""
    return controller_bytes(source.run.shape, elite.parameters, source.about(elite))


def controller_bytes(shape: MlpShape, parameters: Float32Array, about: Mapping[str, str]) -> bytes:
    """Return a controller as a serialised ONNX model.

    Its input ``observation`` is (batch, observation_dim) float32, its output ``action`` (batch, action_dim) float32.

    Args:
        shape: Its layers.
        parameters: (P,) float32 parameters.
        about: What the model's metadata hold, such as `Source.about` tells.

    Raises:
        MissingDependencyError: The onnx package is not installed.
    """
    onnx = require_onnx()
    nodes, weights = _layers(onnx, shape, parameters, "observation")
    inputs = {"observation": shape.sizes[0]}
    return _model(onnx, nodes, weights, inputs, shape.sizes[-1], about)


def onnx_actor_bytes(run: StoredRun, actor: ConditionedActor) -> bytes:
    """Return the actor of a run as a serialised ONNX model.

    Its inputs are ``observation``, (batch, observation_dim) float32, and ``descriptor``, (batch, descriptor_dim)
    float32 in the task's units; its output is ``action``, (batch, action_dim) float32. The model scales the descriptor.

    Raises:
        MissingDependencyError: The onnx package is not installed.
    """
    onnx = require_onnx()
    spec = run.spec
    low, high = np.array(spec.descriptor_low), np.array(spec.descriptor_high)
    constants = {
        "middle": (low + high) / 2,
        "half_range": (high - low) / 2,
        "least": np.array(-1.0),
        "greatest": np.array(1.0),
    }
    weights = [
        onnx.numpy_helper.from_array(np.asarray(v, np.float32), n) for n, v in constants.items()
    ]
    node = onnx.helper.make_node
    nodes = [
        node("Sub", ["descriptor", "middle"], ["from_middle"]),
        node("Div", ["from_middle", "half_range"], ["shares"]),
        node("Clip", ["shares", "least", "greatest"], ["scaled"]),
        node("Concat", ["observation", "scaled"], ["seen"], axis=1),
    ]
    layers, parameters = _layers(onnx, actor.shape, actor.parameters, "seen")
    inputs = {"observation": spec.observation_dim, "descriptor": spec.descriptor_dim}
    own = {
        "descriptor_low": spec.descriptor_low,
        "descriptor_high": spec.descriptor_high,
        "layer_sizes": actor.shape.sizes,
    }
    about = about_robot(run) | {name: json.dumps(value) for name, value in own.items()}
    return _model(onnx, nodes + layers, weights + parameters, inputs, spec.action_dim, about)


def _model(
    onnx: ModuleType,
    nodes: Sequence[Any],
    weights: Sequence[Any],
    inputs: Mapping[str, int],
    actions: int,
    about: Mapping[str, str],
) -> bytes:
    """Return a checked model; `inputs` has the entries of each, `actions` is the number of those of its output."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        nodes,
        "controller",
        [helper.make_tensor_value_info(name, kind, ["batch", n]) for name, n in inputs.items()],
        [helper.make_tensor_value_info("action", kind, ["batch", actions])],
        weights,
    )
    model = helper.make_model(
        graph,
        producer_name="pga_me_ros",
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
    )
    helper.set_model_props(model, dict(about))
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def _layers(
    onnx: ModuleType, shape: MlpShape, parameters: Float32Array, signal: str
) -> tuple[list[Any], list[Any]]:
    """Return the nodes and the initializers of a controller's layers; `signal` is what goes into the first."""
    nodes, weights = [], []
    layers = shape.layers(parameters)
    for i, (weight, bias) in enumerate(layers):
        last = i == len(layers) - 1
        out = "action" if last else f"hidden{i}"
        weights.append(onnx.numpy_helper.from_array(weight, f"weight{i}"))
        weights.append(onnx.numpy_helper.from_array(bias, f"bias{i}"))
        inputs = [signal, f"weight{i}", f"bias{i}"]
        nodes.append(onnx.helper.make_node("Gemm", inputs, [f"sum{i}"], f"layer{i}", transB=1))
        nodes.append(onnx.helper.make_node("Tanh" if last else "Relu", [f"sum{i}"], [out]))
        signal = out
    return nodes, weights
