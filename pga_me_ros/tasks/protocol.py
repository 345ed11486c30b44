"""The task protocol: what a simulated robot must provide to grow a repertoire for it.

To add a robot, write a class with these five methods and a `spec`. Use its name
``my_package.my_module:MyTask`` wherever a task is expected, and
`pga_me_ros.tasks.check.check_task` to find out what is wrong with it. No base class is needed.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.spec import TaskSpec


class NonFiniteActionError(TaskError):
    """An action holds NaN or infinity; it was not applied, and the task remains usable."""


class DivergedError(TaskError):
    """The simulation reached NaN or infinity; the next reset starts a normal episode."""


class Task(Protocol):
    """A simulated robot with a fitness and a behavior descriptor.

    Contract beyond the signatures:
        * An episode depends only on `reset`'s generator and the actions, never on what ran before it
          in the process: equal generators and actions give equal bits in a fresh world and in
          the thousandth episode.
        * Random draws come from that generator only.
        * Modules load without a simulator: import it in ``__init__``, because nodes that never
          simulate read `spec`.
        * Several tasks may live in one process, each with its own world.
    """

    spec: ClassVar[TaskSpec]

    def __init__(self, *, render: bool = False) -> None:
        """Start the simulator.

        Args:
            render: Whether to open a window. A task that cannot draw may omit the argument.
        """
        ...

    def reset(self, rng: np.random.Generator) -> Float32Array:
        """Begin an episode.

        Args:
            rng: Source of the initial pose.

        Returns:
            (observation_dim,) float32 array, the first observation.
        """
        ...

    def step(self, action: Float32Array) -> tuple[Float32Array, float, bool]:
        """Apply an action for one control period.

        Args:
            action: (action_dim,) float32 array.

        Returns:
            The next observation, (observation_dim,) float32; the reward of this step; and whether
            the robot failed (fell). The time limit is not a failure: the caller counts the steps and
            ends the episode.

        Raises:
            NonFiniteActionError: The action holds NaN or infinity. The world is left as it was.
        """
        ...

    def descriptor(self) -> Float64Array:
        """Return the behavior descriptor of the episode so far.

        Returns:
            (descriptor_dim,) float64 array within ``spec.descriptor_low`` and
            ``spec.descriptor_high``.
        """
        ...

    def close(self) -> None:
        """Stop the simulator; a second call does nothing."""
        ...
