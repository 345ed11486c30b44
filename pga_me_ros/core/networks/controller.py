"""A perceptron that is ready to act."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.mlp import MlpShape


class MlpController:
    """A controller that is ready to run: observation in, action out.

    Args:
        shape: Layers.
        parameters: (P,) float32 in the layout of this module; copied.

    Raises:
        NetworkError: The parameters do not fit the layers or are not finite.
    """

    def __init__(self, shape: MlpShape, parameters: Float32Array) -> None:
        """Copy the parameters into the layout that runs fastest."""
        shape.check(parameters)
        self.shape = shape
        # Each layer is one vector-matrix product: the bias is the last row of the matrix and meets
        # a constant one at the end of the layer's input. That takes half the time of separate
        # products and additions.
        self._matrices = [np.vstack((w.T, b)) for w, b in shape.layers(parameters)]
        self._signals = [np.ones(n + 1, np.float32) for n in shape.sizes[:-1]]
        self._observation = self._signals[0][:-1]
        self._hidden = [
            (signal, matrix, out, out[:-1])
            for signal, matrix, out in zip(
                self._signals[:-1], self._matrices[:-1], self._signals[1:], strict=True
            )
        ]
        self._zero = np.float32(0.0)

    def __call__(self, observation: Float32Array) -> Float32Array:
        """Return the action for an observation.

        Args:
            observation: (n_in,) float32, in the order and units of the task.

        Returns:
            (n_out,) float32 within ±1, a fresh array.
        """
        self._observation[:] = observation
        for signal, matrix, _, neurons in self._hidden:
            np.dot(signal, matrix, out=neurons)
            np.maximum(neurons, self._zero, out=neurons)
        action: Float32Array = np.dot(self._signals[-1], self._matrices[-1])
        return np.tanh(action, out=action)
