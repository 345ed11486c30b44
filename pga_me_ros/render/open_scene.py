"""The scene that a recorded robot is drawn in: that of its own simulator where that can draw without a display."""

from __future__ import annotations

import sys
from typing import Protocol

from pga_me_ros.player.camera import Camera
from pga_me_ros.player.model import RobotState
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.process.streams import tell
from pga_me_ros.render.mujoco_scene import MujocoScene, NoOpenGLError
from pga_me_ros.render.scene import Picture, Scene
from pga_me_ros.tasks.body import MujocoBody


class AnyScene(Protocol):
    """Draws one robot."""

    def picture(self, state: RobotState, camera: Camera) -> Picture:
        """Return what a camera sees: (height, width, 3) uint8."""
        ...

    def close(self) -> None:
        """Close the scene; a second call does nothing."""
        ...


def open_scene(recording: Recording, width: int, height: int) -> AnyScene:
    """Return a scene for a recorded robot; whoever opens it closes it.

    Args:
        recording: The episode.
        width: Width of the pictures, pixels.
        height: Their height.

    Raises:
        TaskError: The robot cannot be drawn.
    """
    if isinstance(recording.body, MujocoBody):
        try:
            return MujocoScene(recording.body, width, height)
        except NoOpenGLError as error:
            tell(f"note: drawn by PyBullet's renderer instead: {error}", sys.stderr)
    return Scene(recording.model, width, height)
