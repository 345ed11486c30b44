"""Adam (Kingma & Ba 2015) with its usual constants on one parameter tensor."""

# Annotations must stay types: see `compiled`.
from typing import NamedTuple

import torch
from torch import Tensor

from pga_me_ros.core.gradients.compiled import compiled


class Adam(NamedTuple):
    """What the next step depends on; made by `make_adam`.

    Lists have one entry: torch's fused kernel takes any number of parameter tensors.

    Attributes:
        parameters: Parameters that a step changes.
        moment1: Running mean of the gradients, of the same shape.
        moment2: Running mean of their squares, of the same shape.
        steps: Number of steps taken, a float32 scalar.
    """

    parameters: list[Tensor]
    moment1: list[Tensor]
    moment2: list[Tensor]
    steps: list[Tensor]


def make_adam(parameters: Tensor) -> Adam:
    """Return an optimizer of one tensor that has taken no step."""
    steps = torch.zeros((), device=parameters.device)
    return Adam(
        [parameters], [torch.zeros_like(parameters)], [torch.zeros_like(parameters)], [steps]
    )


def reset_adam(adam: Adam) -> None:
    """Forget all steps."""
    for tensor in (adam.moment1[0], adam.moment2[0], adam.steps[0]):
        tensor.zero_()


@compiled
def adam_step(adam: Adam, gradient: Tensor, learning_rate: float, maximize: bool) -> None:
    """Take one step down the gradient, or up with `maximize`.

    This calls torch's fused kernel directly: the optimizer classes import torch's compiler, which takes seconds and a
    hundred megabytes, and TorchScript does not support `torch.optim.adam.adam`.
    """
    adam.steps[0].add_(1)
    no_maxima: list[Tensor] = []
    torch._fused_adam_(
        adam.parameters,
        [gradient],
        adam.moment1,
        adam.moment2,
        no_maxima,
        adam.steps,
        lr=learning_rate,
        beta1=0.9,
        beta2=0.999,
        weight_decay=0.0,
        eps=1e-8,
        amsgrad=False,
        maximize=maximize,
    )
