"""PyBullet's window, which follows the robot."""

from __future__ import annotations

import math

from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.camera import FIELD_OF_VIEW, Camera
from pga_me_ros.player.model import RobotState

WIDER = math.tan(math.radians(60.0 / 2.0)) / math.tan(math.radians(FIELD_OF_VIEW / 2.0))
"""Height of the window's view relative to `Camera`'s at the same distance; its field of view is 60 degrees."""

SETTLING = 60
"""Frames for which we impose the view: the window reports a changed view only some frames later."""


class Window:
    """Moves the window's view along with the robot; the user chooses angle and distance with the mouse.

    Args:
        reader: The robot.
        state: Its initial state.

    Attributes:
        client: Id of the PyBullet client; a reset may open another world and another window.
    """

    def __init__(self, reader: BodyReader, state: RobotState) -> None:
        import pybullet

        self._pybullet = pybullet
        self.client = reader.client
        self._camera = Camera.for_robot(reader.model, state)
        self._view = (self._camera.distance / WIDER, self._camera.yaw, -self._camera.pitch)
        self._settling = SETTLING
        pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=self.client)

    def follow(self, state: RobotState) -> None:
        """Center the view on the robot."""
        if self._settling:
            self._settling -= 1
        else:
            yaw, pitch, distance = self._pybullet.getDebugVisualizerCamera(self.client)[8:11]
            self._view = (distance, yaw, pitch)
        self._pybullet.resetDebugVisualizerCamera(
            *self._view, self._camera.target(state), self.client
        )
