"""The actor of a repertoire: one network that is told at every step which behavior is wanted."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pga_me_msgs.srv import GetActor

from pga_me_ros.arrays import Float32Array
from pga_me_ros.client.controller import Controller
from pga_me_ros.errors import NetworkError


class Actor:
    """The actor of a repertoire: maps an observation and a wanted descriptor to an action, with NumPy alone.

    The descriptor may be another one at every step. Only one thread may call an actor at a time.

    Attributes:
        controller: The same network as a controller; its observation ends with the wanted descriptor.
        generation: Generation for whose offspring it was trained.
        task: Name of the task that it was learned in.
        observation_names: What each entry of the observation is; units and limits are those of `controller`.
        descriptor_names: What each entry of the descriptor is.
        descriptor_low: (d,) float64 least value of each entry, in the task's units.
        descriptor_high: (d,) float64 greatest value of each entry.
        control_period: Seconds between two actions.
    """

    def __init__(self, controller: Controller, generation: int) -> None:
        """Use `from_response`."""
        d, inputs = len(controller.descriptor_names), controller.layer_sizes[0]
        if not 0 < d < inputs or len(controller.observation_low) != inputs:
            raise NetworkError(
                f"The actor has {inputs} inputs with {len(controller.observation_low)} limits and a descriptor of {d} "
                "entries; expected an observation, then the descriptor, and limits of all. The message is malformed."
            )
        self.controller = controller
        self.generation = generation
        self.task = controller.task
        self.observation_names = controller.observation_names[:-d]
        self.descriptor_names = controller.descriptor_names
        self.descriptor_low = controller.observation_low[-d:]
        self.descriptor_high = controller.observation_high[-d:]
        self.control_period = controller.control_period

    @classmethod
    def from_response(cls, response: GetActor.Response) -> Actor:
        """Return the actor in a response that has one.

        Raises:
            NetworkError: It is malformed, see `Controller.from_msg`.
        """
        return cls(Controller.from_msg(response.controller), response.generation)

    def __call__(self, observation: ArrayLike, descriptor: ArrayLike) -> Float32Array:
        """Return the action for an observation of a robot that is to behave in a certain way.

        Args:
            observation: (observation_dim,) numbers in the order and units of `observation_names`; rounded to float32.
            descriptor: (d,) numbers in the order and units of `descriptor_names`; those beyond the bounds count as at
                the bounds.

        Returns:
            (action_dim,) float32 within ±1, a fresh array.

        Raises:
            NetworkError: One of them has the wrong shape or is not finite: NaN must never reach an actuator.
        """
        wanted = np.asarray(descriptor, np.float64)
        if wanted.shape != self.descriptor_low.shape or not np.isfinite(wanted).all():
            raise NetworkError(
                f"The descriptor is {wanted.tolist() if wanted.size < 10 else wanted.shape}; expected "
                f"{len(self.descriptor_names)} finite numbers: {', '.join(self.descriptor_names)}."
            )
        seen = np.asarray(observation, np.float64)
        if seen.shape != (len(self.observation_names),):
            raise NetworkError(
                f"The observation has the shape {seen.shape}; this actor takes ({len(self.observation_names)},): "
                f"{', '.join(self.observation_names)}."
            )
        wanted = np.clip(wanted, self.descriptor_low, self.descriptor_high)
        return self.controller(np.concatenate([seen, wanted]))
