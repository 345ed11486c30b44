"""Controllers: multi-layer perceptrons stored as one flat float32 vector, run with only NumPy.

Messages and the repertoire file have the same flat layout: for each layer from input to
output, the weights (n_out, n_in) in row-major order, then the biases (n_out,). Hidden layers are
rectified (max(0, x)); the output of a controller goes through tanh, that of a critic is linear.
Robots need only this file and NumPy to run a controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.errors import NetworkError


@dataclass(frozen=True)
class TensorSlice:
    """Place of one weight or bias tensor in the flat vector."""

    offset: int
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of parameters in the tensor."""
        return math.prod(self.shape)

    @property
    def span(self) -> slice:
        """Python slice of the flat vector."""
        return slice(self.offset, self.offset + self.size)


@dataclass(frozen=True)
class MlpShape:
    """Layer sizes of a perceptron and the flat layout that follows from them.

    Args:
        sizes: Neurons per layer: input, hidden ..., output.

    Raises:
        NetworkError: There are fewer than two layers, or a layer without neurons.
    """

    sizes: tuple[int, ...]

    def __post_init__(self) -> None:
        """Check the sizes."""
        object.__setattr__(self, "sizes", tuple(int(n) for n in self.sizes))
        if len(self.sizes) < 2 or min(self.sizes) < 1:
            raise NetworkError(
                f"Layer sizes {list(self.sizes)} make no network; give an input and an output "
                "layer at least, each with one neuron or more, for example [22, 128, 128, 6]."
            )

    @property
    def parameter_count(self) -> int:
        """Length P of the flat vector."""
        return sum((n_in + 1) * n_out for n_in, n_out in pairwise(self.sizes))

    def slices(self) -> tuple[TensorSlice, ...]:
        """Return the tensors in their order in the flat vector: weights, biases, weights, ..."""
        tensors = []
        offset = 0
        for n_in, n_out in pairwise(self.sizes):
            for shape in ((n_out, n_in), (n_out,)):
                tensors.append(TensorSlice(offset, shape))
                offset += tensors[-1].size
        return tuple(tensors)

    def layers(self, parameters: Float32Array) -> list[tuple[Float32Array, Float32Array]]:
        """Return (weights (n_out, n_in), biases (n_out,)) per layer: views of a flat vector."""
        views = [parameters[t.span].reshape(t.shape) for t in self.slices()]
        return list(zip(views[::2], views[1::2], strict=True))

    def check(self, parameters: Any) -> None:
        """Make sure that an array can be the parameters of such a network.

        Raises:
            NetworkError: It is not a (P,) float32 array, or has entries that are not finite.
        """
        if not isinstance(parameters, np.ndarray) or parameters.dtype != np.float32:
            kind = getattr(parameters, "dtype", type(parameters).__name__)
            raise NetworkError(
                f"Parameters are {kind}, not float32; give them as a float32 NumPy array."
            )
        if parameters.shape != (self.parameter_count,):
            raise NetworkError(
                f"Parameters have shape {parameters.shape}, but layers {list(self.sizes)} take "
                f"({self.parameter_count},); check that they belong to the same layer sizes."
            )
        if not np.isfinite(parameters).all():
            bad = int(np.flatnonzero(~np.isfinite(parameters))[0])
            raise NetworkError(
                f"Parameter {bad} is {parameters[bad]}; all must be finite. "
                "The training that made them has diverged; try smaller learning rates."
            )


def random_parameters(shape: MlpShape, rng: np.random.Generator) -> Float32Array:
    """Draw a random controller (Alg. 3, line 10, Nilsson & Cully 2021; distribution as in the authors' code).

    Args:
        shape: Layers of the controller.
        rng: Source of the draws.

    Returns:
        (P,) float32: weights uniform within ±sqrt(6 / (n_in + n_out)) (Xavier), biases within ±1 /
        sqrt(n_in).
    """
    return _uniform(shape, rng, lambda n_in, n_out: math.sqrt(6.0 / (n_in + n_out)))


def random_critic(shape: MlpShape, rng: np.random.Generator) -> Float32Array:
    """Draw a random critic: weights and biases uniform within ±1 / sqrt(n_in), torch's default.

    Args:
        shape: Layers of the critic.
        rng: Source of the draws.

    Returns:
        (P,) float32.
    """
    return _uniform(shape, rng, lambda n_in, _: 1.0 / math.sqrt(n_in))


def _uniform(
    shape: MlpShape, rng: np.random.Generator, weight_limit: Callable[[int, int], float]
) -> Float32Array:
    parameters = np.empty(shape.parameter_count, np.float32)
    for (weights, biases), (n_in, n_out) in zip(
        shape.layers(parameters), pairwise(shape.sizes), strict=True
    ):
        limit = weight_limit(n_in, n_out)
        weights[:] = rng.uniform(-limit, limit, weights.shape)
        limit = 1.0 / math.sqrt(n_in)
        biases[:] = rng.uniform(-limit, limit, biases.shape)
    return parameters
