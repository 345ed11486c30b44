"""Export of controllers as ONNX models, built layer by layer. Needs the onnx package, but not torch."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from pga_me_ros.core.archive.elites import Elite
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
    """Return a controller as a serialized ONNX model.

    Its input ``observation`` is (batch, observation_dim) float32, its output ``action`` (batch, action_dim) float32;
    the model's metadata has the content of `Source.about`.

    Raises:
        PgaError: The onnx package is not installed.
    """
    onnx = require_onnx()
    helper = onnx.helper
    nodes, weights = _layers(onnx, source, elite)
    sizes = source.run.shape.sizes
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
    helper.set_model_props(model, source.about(elite))
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def _layers(onnx: ModuleType, source: Source, elite: Elite) -> tuple[list[Any], list[Any]]:
    """Return the nodes and the initializers of a controller's layers."""
    nodes, weights = [], []
    signal = "observation"
    layers = source.run.shape.layers(elite.parameters)
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
