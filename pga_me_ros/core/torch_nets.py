"""Perceptrons on flat torch tensors with hand-written gradients, several of one shape at a time.

The critics, the greedy controller and PG variation spend all their time in a dozen matrix products
per step. Autograd adds nearly half to that: it makes new tensors each time and computes gradients
that nobody asked for (those of the critic when a controller follows it). Here the products write to
buffers that stay, and each caller asks for what it needs.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor
from torch.optim.adam import adam

from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.policy import MlpShape

ADAM_BETA1 = 0.9
ADAM_BETA2 = 0.999
ADAM_EPSILON = 1e-8


@contextmanager
def torch_threads(threads: int) -> Iterator[None]:
    """Compute with so many threads within the block; the last bits of a sum depend on it."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def choose_device(device: str) -> torch.device:
    """Return the torch device of a name.

    Args:
        device: 'auto' takes a GPU if torch finds one, else the CPU; any other name is torch's own,
            such as 'cpu'.

    Raises:
        SettingsError: torch does not know the device or cannot use it here.
    """
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise SettingsError(
            f"Device '{device}' cannot be used here ({reason}); give 'auto' or 'cpu'."
        ) from error
    return torch.device(device)


class MlpStack:
    """E perceptrons of one shape on a flat parameter tensor, for batches of N inputs.

    `forward` and `backward` write to buffers of the stack: what they return holds until the next
    call.

    Args:
        shape: Layers of each network.
        parameters: (E, P) float32; the networks read it in place, so whoever changes it changes
            them.
        rows: N, inputs per batch.
        tanh: Whether the output goes through tanh (controllers) or is linear (critics).
    """

    def __init__(self, shape: MlpShape, parameters: Tensor, rows: int, *, tanh: bool) -> None:
        """Make the views of the tensors and the buffers."""
        self.shape = shape
        self.parameters = parameters
        self.gradient = torch.zeros_like(parameters)
        self._tanh = tanh
        self._weights, self._biases = _layer_views(shape, parameters)
        # Views are made once: each takes a microsecond, and there would be dozens per gradient step.
        self._weights_transposed = [w.transpose(1, 2) for w in self._weights]
        self._weight_gradients, self._bias_gradients = _layer_views(shape, self.gradient)
        self._signals = [parameters.new_empty((len(parameters), rows, n)) for n in shape.sizes[1:]]
        self._deltas = [torch.empty_like(signal) for signal in self._signals]
        self._deltas_transposed = [d.transpose(1, 2) for d in self._deltas]

    def forward(self, inputs: Tensor) -> Tensor:
        """Return the outputs (E, N, n_out) for inputs (E or 1, N, n_in)."""
        signal, last = self._for_all(inputs), self._signals[-1]
        for weights, biases, out in zip(
            self._weights_transposed, self._biases, self._signals, strict=True
        ):
            signal = torch.baddbmm(biases, signal, weights, out=out)
            if out is not last:
                out.relu_()
        return last.tanh_() if self._tanh else last

    def backward(self, inputs: Tensor, output_gradient: Tensor) -> None:
        """Fill `gradient` (E, P) by backpropagation through the last `forward`.

        Args:
            inputs: (E or 1, N, n_in), the inputs of that call.
            output_gradient: (E or 1, N, n_out), derivative of the objective by the outputs.
        """
        below = [self._for_all(inputs), *self._signals[:-1]]
        self._output_delta(output_gradient)
        for layer in reversed(range(len(self._weights))):
            delta = self._deltas[layer]
            torch.bmm(
                self._deltas_transposed[layer], below[layer], out=self._weight_gradients[layer]
            )
            torch.sum(delta, 1, keepdim=True, out=self._bias_gradients[layer])
            if layer:
                self._delta_below(layer)

    def input_gradient(self, output_gradient: Tensor, first: int, out: Tensor) -> Tensor:
        """Return the derivative by the inputs from column `first` on, and no other.

        Args:
            output_gradient: (E or 1, N, n_out), derivative of the objective by the outputs.
            first: First input column wanted.
            out: (E, N, n_in - first) to write to.
        """
        self._output_delta(output_gradient)
        for layer in reversed(range(1, len(self._weights))):
            self._delta_below(layer)
        return torch.bmm(self._deltas[0], self._weights[0][:, :, first:], out=out)

    def _for_all(self, rows: Tensor) -> Tensor:
        """Return (E, N, n) for (E or 1, N, n)."""
        every = len(self.parameters)
        return rows if len(rows) == every else rows.expand(every, -1, -1)

    def _output_delta(self, output_gradient: Tensor) -> None:
        if self._tanh:
            gradient = self._for_all(output_gradient)
            torch.ops.aten.tanh_backward.grad_input(
                gradient, self._signals[-1], grad_input=self._deltas[-1]
            )
        else:
            self._deltas[-1].copy_(output_gradient)

    def _delta_below(self, layer: int) -> None:
        below = self._deltas[layer - 1]
        torch.bmm(self._deltas[layer], self._weights[layer], out=below)
        # The rectifier's own backward kernel: masking with a comparison takes ten times as long on
        # a CPU.
        torch.ops.aten.threshold_backward.grad_input(
            below, self._signals[layer - 1], 0.0, grad_input=below
        )


def _layer_views(shape: MlpShape, flat: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Return views of (E, P): weights (E, n_out, n_in) and biases (E, 1, n_out) per layer."""
    tensors = shape.slices()
    weights = [flat[:, t.span].unflatten(1, t.shape) for t in tensors[::2]]
    biases = [flat[:, t.span].unsqueeze(1) for t in tensors[1::2]]
    return weights, biases


class FlatAdam:
    """Adam (Kingma & Ba 2015) with its usual constants on one parameter tensor.

    torch's fused kernel through its functional interface: the optimiser classes import torch's
    compiler, which takes seconds and a hundred megabytes.

    Args:
        parameters: Tensor that `step` changes in place.
    """

    def __init__(self, parameters: Tensor) -> None:
        """Start with zero moments."""
        self.parameters = parameters
        self.moment1 = torch.zeros_like(parameters)
        self.moment2 = torch.zeros_like(parameters)
        self.steps = torch.zeros((), device=parameters.device)

    def reset(self) -> None:
        """Forget all steps."""
        for tensor in (self.moment1, self.moment2, self.steps):
            tensor.zero_()

    def step(self, gradient: Tensor, learning_rate: float, *, maximize: bool = False) -> None:
        """Go one step down the gradient, or up with `maximize`."""
        adam(
            [self.parameters],
            [gradient],
            [self.moment1],
            [self.moment2],
            [],
            [self.steps],
            fused=True,
            amsgrad=False,
            beta1=ADAM_BETA1,
            beta2=ADAM_BETA2,
            lr=learning_rate,
            weight_decay=0.0,
            eps=ADAM_EPSILON,
            maximize=maximize,
        )
