"""PyBullet's window, kept on the robot."""

from __future__ import annotations

import math

from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.camera import FIELD_OF_VIEW, Camera
from pga_me_ros.player.model import RobotState

WIDER = math.tan(math.radians(60.0 / 2.0)) / math.tan(math.radians(FIELD_OF_VIEW / 2.0))
"""How much more the window sees from the same place: its field of view is 60 degrees."""

SETTLING = 60
"""Pictures for which the view is imposed: the window tells of a change only some pictures after it was made."""


class Window:
    """Moves the window's view along with the robot; from where it is looked at is up to the user's mouse.

    Args:
        reader: The robot.
        state: Where it is at the start.

    Attributes:
        client: Id of the PyBullet client; a reset may open another world, and with it another window.
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
        """Look at the robot where it is now."""
        if self._settling:
            self._settling -= 1
        else:
            yaw, pitch, distance = self._pybullet.getDebugVisualizerCamera(self.client)[8:11]
            self._view = (distance, yaw, pitch)
        self._pybullet.resetDebugVisualizerCamera(
            *self._view, self._camera.target(state), self.client
        )
