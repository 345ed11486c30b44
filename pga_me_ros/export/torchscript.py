"""Export of controllers as TorchScript, for C++ robots with libtorch."""

from __future__ import annotations

import io
import json
import warnings

import torch
from torch import nn

from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.export.source import Source

ABOUT = "about.json"
"""Extra file of the archive with the content of `Source.about`."""


def torchscript_bytes(source: Source, elite: Elite) -> bytes:
    """Return a controller as a TorchScript archive for ``torch.jit.load``.

    It maps (batch, observation_dim) or (observation_dim,) float32 to actions.
    """
    layers: list[nn.Module] = []
    for weight, bias in source.run.shape.layers(elite.parameters):
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
        torch.jit.save(scripted, out, _extra_files={ABOUT: json.dumps(source.about(elite))})
    return out.getvalue()
