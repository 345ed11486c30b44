"""Perceptrons on flat torch tensors with hand-written gradients, several of one shape at a time.

The critics, the greedy controller and PG variation spend all their time in a dozen matrix products
per step. Autograd adds nearly half to that: it makes new tensors each time and computes gradients
that are not needed (those of the critic when a controller follows it). Here the products write to
reused buffers, and callers compute only the gradients they need.
"""

# Annotations must stay types: see `compiled`.
from typing import NamedTuple

import torch
from torch import Tensor

from pga_me_ros.core.gradients.compiled import compiled
from pga_me_ros.core.networks.mlp import MlpShape


class BatchedMlp(NamedTuple):
    """E perceptrons of one shape with the buffers for batches of N inputs; made by `make_batched_mlp`.

    Lists have an entry per layer. All parameters are views of one tensor, which the networks read in place, so changes
    to it take effect.

    Attributes:
        weights: (E, n_out, n_in).
        weights_transposed: (E, n_in, n_out), views of them, made once instead of dozens of times per gradient step.
        biases: (E, 1, n_out).
        gradient: (E, P), filled by `backward`.
        weight_gradients: (E, n_out, n_in), views of it.
        bias_gradients: (E, 1, n_out), views of it.
        signals: (E, N, n_out), output of each layer.
        deltas: (E, N, n_out), derivatives of the objective with respect to the input of each layer's nonlinearity.
        deltas_transposed: (E, n_out, N), views of them.
        tanh: Whether the output goes through tanh (controllers) or is linear (critics).
    """

    weights: list[Tensor]
    weights_transposed: list[Tensor]
    biases: list[Tensor]
    gradient: Tensor
    weight_gradients: list[Tensor]
    bias_gradients: list[Tensor]
    signals: list[Tensor]
    deltas: list[Tensor]
    deltas_transposed: list[Tensor]
    tanh: bool


def make_batched_mlp(shape: MlpShape, parameters: Tensor, rows: int, *, tanh: bool) -> BatchedMlp:
    """Make networks that read their parameters from a tensor.

    Args:
        shape: Layers of each network.
        parameters: (E, P) float32.
        rows: N, inputs per batch.
        tanh: Whether the output goes through tanh.
    """
    gradient = torch.zeros_like(parameters)
    weights, biases = _layer_views(shape, parameters)
    by_weight, by_bias = _layer_views(shape, gradient)
    signals = [parameters.new_empty((len(parameters), rows, n)) for n in shape.sizes[1:]]
    deltas = [torch.empty_like(signal) for signal in signals]
    return BatchedMlp(
        weights,
        [w.transpose(1, 2) for w in weights],
        biases,
        gradient,
        by_weight,
        by_bias,
        signals,
        deltas,
        [d.transpose(1, 2) for d in deltas],
        tanh,
    )


def _layer_views(shape: MlpShape, flat: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Return views of (E, P): weights (E, n_out, n_in) and biases (E, 1, n_out) per layer."""
    tensors = shape.slices()
    weights = [flat[:, t.span].unflatten(1, t.shape) for t in tensors[::2]]
    biases = [flat[:, t.span].unsqueeze(1) for t in tensors[1::2]]
    return weights, biases


@compiled
def _for_all(nets: BatchedMlp, rows: Tensor) -> Tensor:
    """Return (E, N, n) for (E or 1, N, n)."""
    return rows.expand(nets.weights[0].size(0), -1, -1)


@compiled
def _output_delta(nets: BatchedMlp, output_gradient: Tensor) -> None:
    if nets.tanh:
        torch.ops.aten.tanh_backward(
            _for_all(nets, output_gradient), nets.signals[-1], grad_input=nets.deltas[-1]
        )
    else:
        nets.deltas[-1].copy_(output_gradient)


@compiled
def _delta_below(nets: BatchedMlp, layer: int) -> None:
    below = nets.deltas[layer - 1]
    torch.bmm(nets.deltas[layer], nets.weights[layer], out=below)
    # The rectifier's backward kernel: masking with a comparison takes ten times as long on a CPU.
    torch.ops.aten.threshold_backward(below, nets.signals[layer - 1], 0.0, grad_input=below)


@compiled
def forward(nets: BatchedMlp, inputs: Tensor) -> Tensor:
    """Return the outputs (E, N, n_out) for inputs (E or 1, N, n_in), in a buffer that is valid until the next call."""
    signal = _for_all(nets, inputs)
    last = len(nets.weights) - 1
    for layer, weights in enumerate(nets.weights_transposed):
        signal = torch.baddbmm(nets.biases[layer], signal, weights, out=nets.signals[layer])
        if layer < last:
            signal.relu_()
    return signal.tanh_() if nets.tanh else signal


@compiled
def backward(nets: BatchedMlp, inputs: Tensor, output_gradient: Tensor) -> None:
    """Fill the gradients by backpropagation through the last `forward`.

    Args:
        nets: The networks.
        inputs: (E or 1, N, n_in), the inputs of that call.
        output_gradient: (E or 1, N, n_out), derivative of the objective with respect to the outputs.
    """
    _output_delta(nets, output_gradient)
    for layer in range(len(nets.weights) - 1, -1, -1):
        below = nets.signals[layer - 1] if layer else _for_all(nets, inputs)
        torch.bmm(nets.deltas_transposed[layer], below, out=nets.weight_gradients[layer])
        torch.sum(nets.deltas[layer], 1, keepdim=True, out=nets.bias_gradients[layer])
        if layer:
            _delta_below(nets, layer)


@compiled
def input_gradient(
    nets: BatchedMlp, output_gradient: Tensor, weights: Tensor, out: Tensor
) -> Tensor:
    """Return the derivative with respect to some of the inputs only.

    Args:
        nets: The networks.
        output_gradient: (E or 1, N, n_out), derivative of the objective with respect to the outputs.
        weights: (E, n_hidden, n), the columns of those inputs in the first layer's weights.
        out: (E, N, n) to write to.
    """
    _output_delta(nets, output_gradient)
    for layer in range(len(nets.weights) - 1, 0, -1):
        _delta_below(nets, layer)
    return torch.bmm(nets.deltas[0], weights, out=out)
