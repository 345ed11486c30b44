"""A task's robot as it stands in PyBullet, for whoever shows it; no part of what an evaluation needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Body:
    """Where a task's robot is to be found. A task that is to be played or drawn returns one as its `body`.

    Attributes:
        client: Id of the PyBullet client.
        robot: Body id of the robot.
        torso: Link index of the part whose pose is the robot's, -1 for the base. Links between it and the base, such as
            the slides of a robot that runs in a plane, are not drawn.
        model_path: File that the robot was loaded from.
        efforts: Greatest torque or force by joint name, N·m or N; empty where unknown.
    """

    client: int
    robot: int
    torso: int = -1
    model_path: str = ""
    efforts: Mapping[str, float] = field(default_factory=dict)
