"""Pictures without a display: a copy of the robot in a separate world, drawn by PyBullet's software renderer.

The copy is posed, never simulated, so that drawing cannot change an episode.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.errors import TaskError
from pga_me_ros.player.camera import FIELD_OF_VIEW, Camera
from pga_me_ros.player.model import Color, RobotModel, RobotState
from pga_me_ros.player.urdf import urdf

TILE = 0.5
"""Edge of a tile of the ground, m."""

TILES = (32, 24)
"""Number of tiles around the robot along x and y, both even, so that they can be moved by two unnoticed."""

TILE_COLORS: tuple[Color, Color] = ((0.78, 0.80, 0.83, 1.0), (0.62, 0.66, 0.71, 1.0))
SKY = np.array([[218, 232, 246], [250, 252, 255]], np.float64)
"""Color of the background at the top and at the bottom."""

Picture = NDArray[np.uint8]


class Scene:
    """A robot on a checkered ground.

    Args:
        model: The robot.
        width: Width of the pictures, pixels.
        height: Their height.

    Raises:
        TaskError: PyBullet cannot load the robot's description.
    """

    def __init__(self, model: RobotModel, width: int = 320, height: int = 240) -> None:
        import pybullet

        self._pybullet = pybullet
        self._size = (width, height)
        self._center = model.links[1].center
        self._client: int = pybullet.connect(pybullet.DIRECT)
        try:
            self._ground = self._lay_ground()
            self._robot = self._load(model)
        except BaseException:
            self.close()
            raise
        indices = {}
        for index in range(pybullet.getNumJoints(self._robot, self._client)):
            info = pybullet.getJointInfo(self._robot, index, self._client)
            indices[info[1].decode()] = index
        self._movable = [indices[joint.name] for joint in model.movable]

    def picture(self, state: RobotState, camera: Camera) -> Picture:
        """Return what a camera sees: (height, width, 3) uint8."""
        pybullet, client = self._pybullet, self._client
        # PyBullet's base is the frame of the torso's center of mass, along the axes of its inertia.
        base = state.base @ self._center
        pybullet.resetBasePositionAndOrientation(self._robot, *base, physicsClientId=client)
        for index, position in zip(self._movable, state.positions, strict=True):
            pybullet.resetJointState(self._robot, index, position, 0.0, client)
        self._move_ground(camera.target(state)[:2])
        width, height = self._size
        _, _, colors, _, bodies = pybullet.getCameraImage(
            width,
            height,
            pybullet.computeViewMatrix(camera.eye(state), camera.target(state), (0.0, 0.0, 1.0)),
            pybullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, width / height, 0.1, 50.0),
            lightDirection=(-1.0, -3.0, 4.0),
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=client,
        )
        image = np.array(colors, np.uint8).reshape(height, width, 4)[..., :3]
        nothing = np.array(bodies).reshape(height, width) < 0
        share = np.linspace(0.0, 1.0, height)[:, None, None]
        sky = np.broadcast_to(SKY[0] + share * (SKY[1] - SKY[0]), image.shape)
        image[nothing] = sky[nothing].astype(np.uint8)
        return image

    def close(self) -> None:
        """Close the world; a second call does nothing."""
        if self._client >= 0:
            self._pybullet.disconnect(self._client)
            self._client = -1

    def _load(self, model: RobotModel) -> int:
        # Without its empty first link, for which PyBullet would print a warning; the torso has the same frame.
        model = RobotModel(model.name, model.links[1:], model.joints[1:])
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "robot.urdf"
            file.write_text(urdf(model))
            try:
                return int(
                    self._pybullet.loadURDF(
                        str(file), useFixedBase=True, physicsClientId=self._client
                    )
                )
            except self._pybullet.error as error:
                raise TaskError(f"the robot '{model.name}' cannot be drawn ({error})") from error

    def _lay_ground(self) -> list[int]:
        """Return the bodies of the ground: all tiles of one color, then all of the other."""
        return [self._lay_tiles(parity) for parity in range(2)]

    def _lay_tiles(self, parity: int) -> int:
        pybullet, client = self._pybullet, self._client
        corners: list[tuple[float, float, float]] = []
        triangles: list[int] = []
        for i, j in np.ndindex(*TILES):
            if (i + j) % 2 == parity:
                x, y = (i - TILES[0] / 2) * TILE, (j - TILES[1] / 2) * TILE
                first = len(corners)
                corners += [(x + TILE * a, y + TILE * b, 0.0) for a, b in np.ndindex(2, 2)]
                triangles += [first + k for k in (0, 2, 1, 1, 2, 3)]
        look = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=corners,
            indices=triangles,
            normals=[(0.0, 0.0, 1.0)] * len(corners),
            uvs=[(0.0, 0.0)] * len(corners),
            rgbaColor=TILE_COLORS[parity],
            physicsClientId=client,
        )
        return int(pybullet.createMultiBody(baseVisualShapeIndex=look, physicsClientId=client))

    def _move_ground(self, towards: tuple[float, float]) -> None:
        """Move the tiles to a point by whole periods of their pattern, so that the ground seems to stay."""
        period = 2 * TILE
        x, y = (period * round(value / period) for value in towards)
        for body in self._ground:
            self._pybullet.resetBasePositionAndOrientation(
                body, (x, y, 0.0), (0.0, 0.0, 0.0, 1.0), physicsClientId=self._client
            )
