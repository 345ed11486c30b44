"""A task's robot in PyBullet, for programs that show it; evaluations do not need it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Body:
    """Where to find a task's robot. A task that can be played or drawn has one as its `body`.

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
