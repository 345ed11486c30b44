"""Pictures of MuJoCo's robots by MuJoCo's own renderer, without a display.

A copy of the model is posed, never simulated, so that drawing cannot change an episode.
"""

from __future__ import annotations

import copy
import importlib
import math
import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pga_me_ros.errors import TaskError
from pga_me_ros.player.camera import FIELD_OF_VIEW, Camera
from pga_me_ros.player.model import RobotState
from pga_me_ros.render.scene import Picture
from pga_me_ros.tasks.body import MujocoBody

CHOICE = "MUJOCO_GL"
"""Environment variable of MuJoCo's that names the kind of OpenGL to draw with."""

MOST_GEOMS = 10_000
"""Maximum number of shapes in a picture."""


_PLANE = 0
"""MuJoCo's type of such a geom."""


class NoOpenGLError(TaskError):
    """MuJoCo's renderer finds no OpenGL on this machine."""


class MujocoScene:
    """A robot in the world of its simulation.

    Args:
        body: The robot.
        width: Width of the pictures, pixels.
        height: Their height.

    Raises:
        NoOpenGLError: There is no OpenGL here that draws without a display.
    """

    def __init__(self, body: MujocoBody, width: int = 320, height: int = 240) -> None:
        import mujoco

        self._mujoco = mujoco
        self._model: Any = copy.copy(body.model)
        screen = self._model.vis.global_
        screen.offwidth = max(int(screen.offwidth), width)
        screen.offheight = max(int(screen.offheight), height)
        self._floors = list(_floors_of(self._model))
        self._data = mujoco.MjData(self._model)
        self._context: Any = _opengl(width, height)
        self._size = (width, height)
        self._scene = mujoco.MjvScene(self._model, MOST_GEOMS)
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._renderer: Any = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)

    def picture(self, state: RobotState, camera: Camera) -> Picture:
        """Return what a camera sees: (height, width, 3) uint8."""
        mujoco, model, data = self._mujoco, self._model, self._data
        self._context.make_current()
        data.qpos[:] = state.configuration
        for floor in self._floors:
            floor.move_below(state.base.position)
        mujoco.mj_forward(model, data)
        self._look(camera, state)
        mujoco.mjv_updateScene(
            model,
            data,
            self._options,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        width, height = self._size
        view = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(view, self._scene, self._renderer)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, view, self._renderer)
        return np.flipud(image)  # OpenGL begins at the bottom

    def close(self) -> None:
        """Free what the graphics card or its emulation holds; a second call does nothing."""
        if self._context is not None:
            self._renderer.free()
            self._context.free()
            self._context = None

    def _look(self, camera: Camera, state: RobotState) -> None:
        """Direct MuJoCo's camera: its field of view is the model's, so its distance is another one."""
        view, ours = math.radians(float(self._model.vis.global_.fovy)), math.radians(FIELD_OF_VIEW)
        to = self._camera
        to.lookat[:] = camera.target(state)
        to.distance = camera.distance * math.tan(ours / 2.0) / math.tan(view / 2.0)
        to.azimuth, to.elevation = 90.0 + camera.yaw, -camera.pitch


class Floor:
    """A plane of the world: it is drawn as large as it is, and a gait may go beyond.

    Args:
        model: The model.
        geom: Id of the plane.
    """

    def __init__(self, model: Any, geom: int) -> None:
        model.geom_sameframe[geom] = 0  # otherwise, its own position would be passed over
        self._position = model.geom_pos[geom]  # a view
        self._origin = self._position[:2].copy()
        material = int(model.geom_matid[geom])
        repeat = np.ones(2) if material < 0 else np.array(model.mat_texrepeat[material], np.float64)
        uniform = material < 0 or bool(model.mat_texuniform[material])
        self._period = (1.0 if uniform else 2.0 * model.geom_size[geom, :2]) / repeat

    def move_below(self, position: Sequence[float]) -> None:
        """Move it to a point by whole periods of its texture, so that it seems to stay."""
        steps = np.round((np.array(position[:2]) - self._origin) / self._period)
        self._position[:2] = self._origin + steps * self._period


def _floors_of(model: Any) -> Iterator[Floor]:
    """Yield the level planes of limited size in the world."""
    for geom in range(int(model.ngeom)):
        plane = int(model.geom_type[geom]) == _PLANE and int(model.geom_bodyid[geom]) == 0
        level = abs(float(model.geom_quat[geom, 0])) > 1.0 - 1e-6
        if plane and level and (model.geom_size[geom, :2] > 0.0).all():
            yield Floor(model, geom)


def _opengl(width: int, height: int) -> Any:
    """Return a context of OpenGL that draws into memory, and make it the current one.

    Raises:
        NoOpenGLError: There is none.
    """
    named = os.environ.get(CHOICE, "")
    # A window's OpenGL draws without a window, too, but only where there is a display.
    kinds = [named] if named else ["egl", *(["glfw"] if os.environ.get("DISPLAY") else [])]
    reasons = []
    for kind in kinds:
        try:
            context = importlib.import_module(f"mujoco.{kind}").GLContext(width, height)
            context.make_current()
        except Exception as error:  # libraries that are missing, drivers that fail
            reasons.append(f"{kind}: {' '.join(str(error).split()) or type(error).__name__}")
        else:
            return context
    raise NoOpenGLError(
        f"MuJoCo's renderer finds no OpenGL here ({'; '.join(reasons)}); install Mesa (sudo apt install libegl1 "
        f"libgl1-mesa-dri), or set {CHOICE} to egl, osmesa or glfw, whichever works here."
    )
