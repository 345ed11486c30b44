"""A camera that keeps the robot in the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pga_me_ros.player.model import RobotModel, RobotState, link_poses
from pga_me_ros.player.transform import Transform, Vector

FIELD_OF_VIEW = 30.0
"""Vertical field of view, degrees; narrow, so that perspective distorts the robot little."""

FLAT = 0.35
"""A robot is flat if its width is less than this share of its length or height, whichever is greater."""

MARGIN = 1.75
"""Height of the view divided by the robot's initial height: room for hops, and for text above the robot."""

CENTER = 0.6
"""Height of the picture's center divided by the robot's initial height."""


@dataclass(frozen=True)
class Camera:
    """Looks at the robot from its right-hand side, so that it runs to the right of the picture.

    Attributes:
        distance: Distance from the point that it looks at, m.
        height: Height of that point above the ground, m.
        pitch: Angle at which it looks down, degrees.
        yaw: Angle by which it is ahead of the robot, degrees.
    """

    distance: float
    height: float
    pitch: float
    yaw: float

    @classmethod
    def for_robot(cls, model: RobotModel, state: RobotState) -> Camera:
        """Return the camera for a robot: from the side for a flat one, else also from ahead and above.

        Args:
            model: The robot.
            state: Its initial state.
        """
        low, high = extent(model, state)
        length, width, height = (b - a for a, b in zip(low, high, strict=True))
        flat = width < FLAT * max(length, height)
        size = max(height, 0.75 * (length if flat else math.hypot(length, width)))
        distance = MARGIN * size / (2.0 * math.tan(math.radians(FIELD_OF_VIEW / 2.0)))
        return cls(distance, CENTER * high[2], *((8.0, 0.0) if flat else (25.0, 25.0)))

    def target(self, state: RobotState) -> Vector:
        """Return the point that it looks at: it follows the robot along the ground, not up and down."""
        return (state.base.position[0], state.base.position[1], self.height)

    def eye(self, state: RobotState) -> Vector:
        """Return the position of the camera, m."""
        x, y, z = self.target(state)
        pitch, yaw = math.radians(self.pitch), math.radians(self.yaw)
        aside = self.distance * math.cos(pitch)
        return (
            x + aside * math.sin(yaw),
            y - aside * math.cos(yaw),
            z + self.distance * math.sin(pitch),
        )


def extent(model: RobotModel, state: RobotState) -> tuple[Vector, Vector]:
    """Return the low and high corners of a box around the robot's shapes, m, in the world."""
    poses = link_poses(model, state)
    low, high = [math.inf] * 3, [-math.inf] * 3
    for link in model.links:
        for shape in link.shapes:
            thick = max(shape.size) if shape.kind in ("box", "mesh") else shape.size[-1]
            half = 0.5 * shape.size[0] if len(shape.size) == 2 else 0.0
            for along in (-half, half):
                end = (poses[link.name] @ shape.pose @ Transform((0.0, 0.0, along))).position
                low = [min(a, x - thick) for a, x in zip(low, end, strict=True)]
                high = [max(b, x + thick) for b, x in zip(high, end, strict=True)]
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])
