"""Export of controllers as TorchScript, for C++ robots with libtorch."""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.dependencies import imported
from pga_me_ros.export.source import Source

ABOUT = "about.json"
"""Extra file of the archive with the content of `Source.about`."""


def require_torch() -> ModuleType:
    """Return the torch package.

    Raises:
        MissingDependencyError: torch is not installed.
    """
    return imported("torch", purpose="export to TorchScript")


def torchscript_bytes(source: Source, elite: Elite) -> bytes:
    """Return an elite's controller as a TorchScript archive, see `scripted_bytes`."""
    return scripted_bytes(source.run.shape, elite.parameters, source.about(elite))


def scripted_bytes(shape: MlpShape, parameters: Float32Array, about: Mapping[str, str]) -> bytes:
    """Return a controller as a TorchScript archive for ``torch.jit.load``.

    It maps (batch, observation_dim) or (observation_dim,) float32 to actions.

    Args:
        shape: Its layers.
        parameters: (P,) float32 parameters.
        about: What the archive's extra file `ABOUT` holds, such as `Source.about` tells.

    Raises:
        MissingDependencyError: torch is not installed.
    """
    torch = require_torch()
    nn = torch.nn
    layers: list[Any] = []
    for weight, bias in shape.layers(parameters):
        layer = nn.Linear(weight.shape[1], weight.shape[0])
        layer.weight = nn.Parameter(torch.from_numpy(weight.copy()), requires_grad=False)
        layer.bias = nn.Parameter(torch.from_numpy(bias.copy()), requires_grad=False)
        layers += [layer, nn.ReLU()]
    layers[-1] = nn.Tanh()
    out = io.BytesIO()
    with warnings.catch_warnings():
        # torch recommends torch.export, which libtorch cannot load without a compiler.
        warnings.simplefilter("ignore", DeprecationWarning)
        scripted = torch.jit.script(nn.Sequential(*layers).eval())
        torch.jit.save(scripted, out, _extra_files={ABOUT: json.dumps(about)})
    return out.getvalue()
