"""The simulator's window. PyBullet's is made to follow the robot; others move their view themselves."""

from __future__ import annotations

import math
from typing import Protocol

from pga_me_ros.player.camera import FIELD_OF_VIEW, Camera
from pga_me_ros.player.model import RobotModel, RobotState
from pga_me_ros.player.reader import Reader
from pga_me_ros.tasks.body import AnyBody, Body

WIDER = math.tan(math.radians(60.0 / 2.0)) / math.tan(math.radians(FIELD_OF_VIEW / 2.0))
"""Height of the window's view relative to `Camera`'s at the same distance; its field of view is 60 degrees."""

SETTLING = 60
"""Frames for which we impose the view: the window reports a changed view only some frames later."""


class Window(Protocol):
    """A window that a robot is seen in."""

    def shows(self, body: AnyBody) -> bool:
        """Whether it is the window of this robot: a reset may open another world and another window."""
        ...

    def follow(self, state: RobotState) -> None:
        """Center the view on the robot."""
        ...


def window_of(reader: Reader, state: RobotState) -> Window:
    """Return the window that a task has opened for its robot.

    Args:
        reader: The robot.
        state: Its initial state.
    """
    if isinstance(reader.body, Body):
        return BulletWindow(reader.body, reader.model, state)
    return OwnWindow()


class OwnWindow:
    """A window that its simulator draws and moves."""

    def shows(self, body: AnyBody) -> bool:
        """Whether it is the window of this robot."""
        return not isinstance(body, Body)

    def follow(self, state: RobotState) -> None:
        """Leave the view to the simulator."""


class BulletWindow:
    """Moves the view of PyBullet's window along with the robot; the user chooses angle and distance with the mouse.

    Args:
        body: The robot.
        model: Its links and joints.
        state: Its initial state.
    """

    def __init__(self, body: Body, model: RobotModel, state: RobotState) -> None:
        import pybullet

        self._pybullet = pybullet
        self._client = body.client
        self._camera = Camera.for_robot(model, state)
        self._view = (self._camera.distance / WIDER, self._camera.yaw, -self._camera.pitch)
        self._settling = SETTLING
        pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=self._client)

    def shows(self, body: AnyBody) -> bool:
        """Whether it is the window of this robot."""
        return isinstance(body, Body) and body.client == self._client

    def follow(self, state: RobotState) -> None:
        """Center the view on the robot."""
        if self._settling:
            self._settling -= 1
        else:
            yaw, pitch, distance = self._pybullet.getDebugVisualizerCamera(self._client)[8:11]
            self._view = (distance, yaw, pitch)
        self._pybullet.resetDebugVisualizerCamera(
            *self._view, self._camera.target(state), self._client
        )
