"""Controllers of a repertoire, ready to run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pga_me_msgs.msg import Controller as ControllerMsg

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.networks.controller import MlpController as Network
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.errors import NetworkError


class Controller:
    """A controller of the repertoire: maps an observation to an action, with NumPy alone.

    Its actions equal, bit for bit, those in the evaluation that gave the behavior's fitness. Only one thread may call
    it at a time.

    Attributes:
        task: Name of the task that it was learned in.
        layer_sizes: Neurons per layer, from the observation to the action.
        parameters: (P,) float32: for each layer the weights (out, in) row by row, then the biases; read-only.
        observation_names: What each entry of the observation is.
        observation_units: Unit of each entry.
        observation_low: Least value of each entry; empty if unknown or unlimited.
        observation_high: Greatest value of each entry; empty if unknown or unlimited.
        joint_names: Joints with an entry ``NAME/position``, which is -1 at the lower limit and +1 at the upper one.
        joint_low: Lower limit of each of these joints, rad or m.
        joint_high: Upper limit of each of these joints, rad or m.
        descriptor_names: What each entry of the behavior's descriptor is.
        action_names: What each entry of the action controls.
        action_units: Unit of each entry.
        action_low: Least value of each action entry.
        action_high: Greatest value of each action entry.
        control_period: Seconds between two actions.
    """

    def __init__(self, msg: ControllerMsg) -> None:
        """Use `from_msg`."""
        shape = _checked_shape(msg)
        self.task: str = msg.task
        self.layer_sizes = shape.sizes
        self.parameters = np.array(msg.parameters, np.float32)
        self.parameters.flags.writeable = False
        self.observation_names = tuple(msg.observation_names)
        self.observation_units = tuple(msg.observation_units)
        self.observation_low = read_only(msg.observation_low)
        self.observation_high = read_only(msg.observation_high)
        self.joint_names = tuple(msg.joint_names)
        self.joint_low = read_only(msg.joint_low)
        self.joint_high = read_only(msg.joint_high)
        self.descriptor_names = tuple(msg.descriptor_names)
        self.action_names = tuple(msg.action_names)
        self.action_units = tuple(msg.action_units)
        self.action_low = read_only(msg.action_low)
        self.action_high = read_only(msg.action_high)
        self.control_period: float = msg.control_period
        self._network = Network(shape, self.parameters)
        self._inputs = (shape.sizes[0],)

    @classmethod
    def from_msg(cls, msg: ControllerMsg) -> Controller:
        """Make a controller from a message.

        Raises:
            NetworkError: Layers, activations, parameters or names do not match, or a parameter is not finite.
        """
        return cls(msg)

    def __call__(self, observation: ArrayLike) -> Float32Array:
        """Return the action for an observation.

        Args:
            observation: (observation_dim,) numbers in the order and units of `observation_names`; rounded to float32.

        Returns:
            (action_dim,) float32 within ±1, a fresh array.

        Raises:
            NetworkError: The observation has the wrong shape or is not finite: NaN must never reach an actuator.
        """
        values = np.asarray(observation, np.float32)
        if values.shape != self._inputs or not np.isfinite(values).all():
            raise NetworkError(self._complaint(values))
        return self._network(values)

    def _complaint(self, values: Float32Array) -> str:
        if values.shape != self._inputs:
            return (
                f"The observation has the shape {values.shape}; this controller takes {self._inputs}: "
                f"{', '.join(self.observation_names)}."
            )
        bad = int(np.flatnonzero(~np.isfinite(values))[0])
        return (
            f"Entry {bad} of the observation ({self.observation_names[bad]}) is {values[bad]}; "
            "give finite numbers, and stop the robot when a sensor fails."
        )


def read_only(numbers: Any) -> Float64Array:
    """Return numbers as a float64 array that cannot be changed."""
    values = np.array(numbers, np.float64)
    values.flags.writeable = False
    return values


def _checked_shape(msg: ControllerMsg) -> MlpShape:
    """Return the layers of the controller in a message.

    Raises:
        NetworkError: The fields do not match. Number and values of the parameters are not checked here.
    """
    shape = MlpShape(tuple(msg.layer_sizes))
    expected = ["relu"] * (len(shape.sizes) - 2) + ["tanh"]
    if list(msg.activations) != expected:
        raise NetworkError(
            f"The controller's activations are {list(msg.activations)}, but layers {list(shape.sizes)} of this "
            f"version take {expected}; use the pga_me_ros that serves the repertoire."
        )
    widths = {"observation_names": 0, "observation_units": 0}
    widths |= {"action_names": -1, "action_units": -1, "action_low": -1, "action_high": -1}
    if msg.observation_low or msg.observation_high:
        widths |= {"observation_low": 0, "observation_high": 0}
    if not len(msg.joint_names) == len(msg.joint_low) == len(msg.joint_high):
        raise NetworkError(
            f"The controller has {len(msg.joint_names)} joint_names, {len(msg.joint_low)} joint_low and "
            f"{len(msg.joint_high)} joint_high; the message is malformed."
        )
    for name, layer in widths.items():
        if len(getattr(msg, name)) != shape.sizes[layer]:
            raise NetworkError(
                f"The controller has {len(getattr(msg, name))} {name}, but its layers {list(shape.sizes)} need "
                f"{shape.sizes[layer]}; the message is malformed."
            )
    return shape
