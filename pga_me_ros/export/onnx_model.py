"""Export of controllers as ONNX models, built layer by layer. Needs the onnx package, but not torch."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.errors import PgaError
from pga_me_ros.export.source import Source

OPSET = 13
"""Old enough for robots, new enough for every operator used here."""

IR_VERSION = 8


def require_onnx() -> ModuleType:
    """Return the onnx package.

    Raises:
        PgaError: onnx is not installed.
    """
    try:
        import onnx
        import onnx.helper
        import onnx.numpy_helper
    except ImportError as error:
        raise PgaError(
            f"--to onnx needs the Python package onnx, which is not installed ({error}); install it with "
            "`pip install onnx`, or choose --to npz or torchscript."
        ) from None
    return onnx


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
        PgaError: The onnx package is not installed.
    """
    onnx = require_onnx()
    helper = onnx.helper
    nodes, weights = _layers(onnx, shape, parameters)
    sizes = shape.sizes
    kind = onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        nodes,
        "controller",
        [helper.make_tensor_value_info("observation", kind, ["batch", sizes[0]])],
        [helper.make_tensor_value_info("action", kind, ["batch", sizes[-1]])],
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
    onnx: ModuleType, shape: MlpShape, parameters: Float32Array
) -> tuple[list[Any], list[Any]]:
    """Return the nodes and the initializers of a controller's layers."""
    nodes, weights = [], []
    signal = "observation"
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
