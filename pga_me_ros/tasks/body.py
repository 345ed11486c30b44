"""A task's robot in its simulator, for programs that show it; evaluations do not need it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Body:
    """Where to find a task's robot in PyBullet. A task that can be played or drawn has one as its `body`.

    Attributes:
        client: Id of the PyBullet client.
        robot: Body id of the robot.
        torso: Link index of the part whose pose is the robot's, -1 for the base. Links between it and the base, such as
            the slides of a planar robot, are not drawn.
        model_path: File that the robot was loaded from.
        efforts: Maximum torque or force by joint name, N·m or N; empty if unknown.
    """

    client: int
    robot: int
    torso: int = -1
    model_path: str = ""
    efforts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class MujocoBody:
    """Where to find a task's robot in MuJoCo, likewise.

    Attributes:
        model: The ``MjModel``.
        data: The simulation's ``MjData``.
        torso: Id of the body whose pose is the robot's. The robot is all that hangs on it; joints between it and the
            world are not part of the robot.
        name: Name of the robot.
        efforts: As in `Body`.
    """

    model: Any
    data: Any
    torso: int = 1
    name: str = "robot"
    efforts: Mapping[str, float] = field(default_factory=dict)


AnyBody = Body | MujocoBody
"""What can be the `body` of a task."""
