"""Networks that are conditioned on a descriptor, and the plain ones that they become for a fixed descriptor.

DCRL-MAP-Elites (Faldor et al. 2025) learns an actor pi(s | d) and critics Q(s, a | d). Their input is the observation,
then the descriptor scaled to -1..1, then, for critics, the action. What an input that stays the same adds to the first
layer can join its bias: with the descriptor fixed, the actor is a controller like any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import RobotDimensions
from pga_me_ros.errors import NetworkError


class DescribedRobot(RobotDimensions, Protocol):
    """What a conditioned network needs to know of a task; every task's spec provides it."""

    @property
    def descriptor_low(self) -> tuple[float, ...]:
        """Lower bound of each descriptor dimension."""

    @property
    def descriptor_high(self) -> tuple[float, ...]:
        """Upper bound of each descriptor dimension."""


@dataclass(frozen=True)
class ConditionedDimensions:
    """Dimensions of a robot whose observation is followed by a descriptor, for the shapes of conditioned networks."""

    observation_dim: int
    action_dim: int

    @classmethod
    def of(cls, robot: DescribedRobot) -> ConditionedDimensions:
        """Add a task's descriptor to its observation."""
        return cls(robot.observation_dim + len(robot.descriptor_low), robot.action_dim)


def scaled(descriptors: ArrayLike, robot: DescribedRobot) -> Float64Array:
    """Return descriptors in units of half their range, measured from its middle.

    Args:
        descriptors: (..., d) numbers; those beyond the bounds count as at the bounds, as for the archive's cells.
        robot: Task that they are of.

    Returns:
        (..., d) float64 within ±1.

    Raises:
        NetworkError: There are more or fewer than d numbers, or one is not finite.
    """
    values = np.asarray(descriptors, np.float64)
    low, high = np.asarray(robot.descriptor_low), np.asarray(robot.descriptor_high)
    if not values.ndim or values.shape[-1] != len(low) or not np.isfinite(values).all():
        raise NetworkError(
            f"Descriptors are {values.tolist() if values.size < 10 else values.shape}; expected {len(low)} finite "
            "numbers each."
        )
    return np.clip(2.0 * (values - low) / (high - low) - 1.0, -1.0, 1.0)


def conditions(descriptors: Float64Array, robot: DescribedRobot) -> Float32Array:
    """Return (n, d) descriptors as conditioned networks take them: scaled, (n, d) float32."""
    return scaled(descriptors, robot).astype(np.float32)


def folded(
    shape: MlpShape, parameters: Float32Array, first: int, inputs: Float32Array
) -> tuple[MlpShape, Float32Array]:
    """Return networks in which some inputs are fixed: their part W_d d of the first layer joins its bias.

    Every network is computed by itself, so it has the same bits alone and among others.

    Args:
        shape: Layers of the network.
        parameters: (P,) float32.
        first: Number of the first input that is fixed, from 0.
        inputs: (n, d) float32 values of the inputs ``first`` to ``first + d - 1``, one row per network that is wanted.

    Returns:
        Layers without those inputs, and (n, P') float32 parameters.

    Raises:
        NetworkError: The parameters do not fit the layers, or there are no such inputs.
    """
    shape.check(parameters)
    n, d = inputs.shape
    if first < 0 or first + d > shape.sizes[0] or d == shape.sizes[0]:
        raise NetworkError(
            f"Inputs {first} to {first + d - 1} cannot be fixed in layers {list(shape.sizes)}; at least one of the "
            f"{shape.sizes[0]} inputs must be left."
        )
    (weights, biases), *_ = shape.layers(parameters)
    plain = MlpShape((shape.sizes[0] - d, *shape.sizes[1:]))
    out = np.empty((n, plain.parameter_count), np.float32)
    kept = np.delete(weights, np.s_[first : first + d], axis=1)
    out[:, : kept.size] = kept.ravel()
    # Entry by entry, because a matrix product may round differently for another number of rows.
    sums = np.tile(biases.astype(np.float64), (n, 1))
    for i in range(d):
        sums += inputs[:, i, None].astype(np.float64) * weights[:, first + i]
    after = kept.size + len(biases)
    out[:, kept.size : after] = sums
    out[:, after:] = parameters[weights.size + len(biases) :]
    return plain, out


class ConditionedActor:
    """One network for all behaviors: observation and wanted descriptor in, action out.

    Args:
        robot: Task that it was trained for.
        shape: Layers; the input is the observation, then the descriptor.
        parameters: (P,) float32; copied.

    Attributes:
        shape: Layers.
        parameters: (P,) float32.

    Raises:
        NetworkError: The parameters do not fit the layers, or the layers not the task.
    """

    def __init__(self, robot: DescribedRobot, shape: MlpShape, parameters: Float32Array) -> None:
        """Copy the parameters."""
        seen = ConditionedDimensions.of(robot)
        if (shape.sizes[0], shape.sizes[-1]) != (seen.observation_dim, seen.action_dim):
            raise NetworkError(
                f"An actor with layers {list(shape.sizes)} does not fit the task; expected {seen.observation_dim} "
                f"inputs (the observation and the descriptor) and {seen.action_dim} outputs."
            )
        self._robot = robot
        self._act = MlpController(shape, parameters)
        self.shape = shape
        self.parameters = parameters.copy()

    def __call__(self, observation: Float32Array, descriptor: ArrayLike) -> Float32Array:
        """Return the action for an observation of a robot that is to behave in a certain way.

        Args:
            observation: (observation_dim,) float32, in the order and units of the task.
            descriptor: Wanted descriptor, d numbers in the task's units.

        Returns:
            (action_dim,) float32 within ±1, a fresh array.

        Raises:
            NetworkError: The descriptor has another number of entries, or one is not finite.
        """
        condition = scaled(descriptor, self._robot).astype(np.float32)
        return self._act(np.concatenate([np.asarray(observation, np.float32), condition]))

    def at(self, descriptor: ArrayLike) -> MlpController:
        """Return the plain controller for a wanted descriptor, d numbers in the task's units.

        It needs less time per action, and has the layers of the archive's controllers.

        Raises:
            NetworkError: The descriptor has another number of entries, or one is not finite.
        """
        wanted = conditions(np.asarray(descriptor, np.float64)[None], self._robot)
        plain, parameters = folded(self.shape, self.parameters, self._robot.observation_dim, wanted)
        return MlpController(plain, parameters[0])

    def in_task_units(self) -> Float32Array:
        """Return the parameters of the same network for descriptors in the task's units.

        The scaling to -1..1 joins the first layer, so the layers stay what they are. Clip descriptors to their bounds
        before they go in: unlike the actor itself, the network goes on beyond them.

        Returns:
            (P,) float32.
        """
        out = self.parameters.copy()
        (weights, biases), *_ = self.shape.layers(out)
        low, high = np.array(self._robot.descriptor_low), np.array(self._robot.descriptor_high)
        of_descriptor = weights[:, self._robot.observation_dim :]
        own = of_descriptor.astype(np.float64)
        of_descriptor[:] = own * (2.0 / (high - low))
        biases -= own @ ((high + low) / (high - low))
        return out
