"""Reads a robot from MuJoCo: its model once, its state after each step, without changing the simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pga_me_ros.errors import TaskError
from pga_me_ros.player.model import (
    BASE_LINK,
    NO_SPEED_LIMIT,
    TORSO_CENTER,
    Joint,
    Link,
    RobotModel,
    RobotState,
    Shape,
    free_name,
    motion,
)
from pga_me_ros.player.transform import ZERO, Transform, Vector
from pga_me_ros.tasks.body import MujocoBody

_KINDS = {2: "prismatic", 3: "revolute"}
"""MuJoCo's joints of one degree of freedom."""

_SPHERE, _CAPSULE, _CYLINDER, _BOX = 2, 3, 5, 6

_SHOWN_GROUPS = 3
"""Groups of geoms that MuJoCo's viewers show by default: those below it."""

_NO_COLOR = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's color of a geom that names none; it then has that of its material."""


class MujocoReader:
    """Reads one robot: the tree of bodies below its torso.

    What the page and ROS tools cannot draw without a file, such as meshes and ellipsoids, is left out; MuJoCo's own
    renderer draws it. A copy of the simulation's state is posed, so that reading cannot change an episode.

    Args:
        body: The robot in its simulation.

    Attributes:
        body: The robot in its simulation.
        model: Its links and joints.

    Raises:
        TaskError: A joint below the torso has several degrees of freedom, or slides without limits.
    """

    def __init__(self, body: MujocoBody) -> None:
        import mujoco

        self._mujoco = mujoco
        self.body = body
        self._model: Any = body.model
        self._copy = mujoco.MjData(self._model)
        self._below = list(self._below_torso())
        self._movable: list[int] = []
        self.model = self._read_model()
        self._positions = [int(self._model.jnt_qposadr[joint]) for joint in self._movable]
        self._speeds = [int(self._model.jnt_dofadr[joint]) for joint in self._movable]

    def state(self) -> RobotState:
        """Return where the robot is now."""
        mujoco, copy, torso = self._mujoco, self._copy, self.body.torso
        copy.qpos[:], copy.qvel[:] = self.body.data.qpos, self.body.data.qvel
        mujoco.mj_kinematics(self._model, copy)
        mujoco.mj_comPos(self._model, copy)
        mujoco.mj_comVel(self._model, copy)
        speed = np.empty(6)
        mujoco.mj_objectVelocity(self._model, copy, mujoco.mjtObj.mjOBJ_BODY, torso, speed, 0)
        base = _transform(copy.xipos[torso], copy.xquat[torso])
        return RobotState(
            base,
            _vector(speed[3:]),
            _vector(speed[:3]),
            tuple(copy.qpos[self._positions].tolist()),
            tuple(copy.qvel[self._speeds].tolist()),
            base,
            tuple(copy.qpos.tolist()),
        )

    def _below_torso(self) -> Iterator[int]:
        """Yield the bodies below the torso, parents first."""
        below = {self.body.torso}
        for index in range(1, int(self._model.nbody)):
            if int(self._model.body_parentid[index]) in below:
                below.add(index)
                yield index

    def _read_model(self) -> RobotModel:
        torso = self.body.torso
        names = {index: self._body_name(index) for index in (torso, *self._below)}
        base = free_name(names.values(), BASE_LINK, TORSO_CENTER)
        # The torso's frame may be anywhere, so its center of mass is the reference, with the torso's orientation.
        center = _transform(self._model.body_ipos[torso], (1.0, 0.0, 0.0, 0.0))
        weld = free_name(self._joint_names, f"{base}_to_{names[torso]}")
        links = [
            Link(base, 0.0, ZERO, Transform(), ()),
            self._link(torso, names[torso], center.inverse()),
        ]
        joints = [Joint(weld, "fixed", base, names[torso], Transform())]
        frames = {torso: center.inverse()}
        for index in self._below:
            parent = int(self._model.body_parentid[index])
            origin = frames[parent] @ _transform(
                self._model.body_pos[index], self._model.body_quat[index]
            )
            above = names[parent]
            chain = self._joints_of(index)
            anchor = Transform()
            for joint in chain:
                # A link turns about its own frame, which therefore lies in the joint's anchor.
                at = Transform(_vector(self._model.jnt_pos[joint]))
                last = joint == chain[-1]
                taken = [*names.values(), *(link.name for link in links)]
                name = names[index] if last else free_name(taken, f"{names[index]}_part")
                joints.append(self._joint(joint, above, name, origin @ anchor.inverse() @ at))
                origin, anchor, above = Transform(), at, name
                if not last:
                    links.append(Link(name, 0.0, ZERO, Transform(), ()))
                self._movable.append(joint)
            if not chain:
                weld = free_name(self._joint_names, f"{above}_to_{names[index]}")
                joints.append(Joint(weld, "fixed", above, names[index], origin))
            frames[index] = anchor.inverse()
            links.append(self._link(index, names[index], frames[index]))
        return RobotModel(self.body.name or "robot", tuple(links), tuple(joints))

    def _link(self, index: int, name: str, frame: Transform) -> Link:
        """Return a link, given the pose of MuJoCo's frame of its body in the frame that we give it."""
        model = self._model
        center = _transform(model.body_ipos[index], model.body_iquat[index])
        return Link(
            name,
            float(model.body_mass[index]),
            _vector(model.body_inertia[index]),
            frame @ center,
            tuple(self._shapes(index, frame)),
        )

    def _joint(self, joint: int, parent: str, child: str, origin: Transform) -> Joint:
        model = self._model
        name, kind = self._joint_name(joint), _KINDS.get(int(model.jnt_type[joint]))
        if kind is None:
            raise TaskError(
                f"joint '{name}' has several degrees of freedom; only robots with hinges and slides can be shown"
            )
        lower, upper = (float(bound) for bound in model.jnt_range[joint])
        if not model.jnt_limited[joint]:
            if kind == "prismatic":
                raise TaskError(
                    f"joint '{name}' slides without limits, which URDF cannot express; give it limits"
                )
            kind, lower, upper = "continuous", 0.0, 0.0
        axis = _vector(model.jnt_axis[joint])
        # MuJoCo moves a joint by the difference to its reference position.
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        origin = origin @ motion(kind, axis, -reference)
        effort = self._effort(joint)
        return Joint(
            name, kind, parent, child, origin, axis, lower, upper, effort, NO_SPEED_LIMIT, joint
        )

    def _effort(self, joint: int) -> float:
        """Return the greatest torque or force of the motors on a joint, 0 if there are none."""
        model = self._model
        return max(
            (
                abs(float(model.actuator_gear[i, 0]))
                * float(abs(model.actuator_ctrlrange[i]).max())
                for i in range(int(model.nu))
                if int(model.actuator_trnid[i, 0]) == joint
            ),
            default=0.0,
        )

    def _shapes(self, index: int, frame: Transform) -> Iterator[Shape]:
        model = self._model
        first = int(model.body_geomadr[index])
        for geom in range(first, first + int(model.body_geomnum[index])):
            kind, (a, b, c) = int(model.geom_type[geom]), model.geom_size[geom].tolist()
            kinds: dict[int, tuple[str, tuple[float, ...]]] = {
                _SPHERE: ("sphere", (a,)),
                _CAPSULE: ("capsule", (2.0 * b, a)),
                _CYLINDER: ("cylinder", (2.0 * b, a)),
                _BOX: ("box", (2.0 * a, 2.0 * b, 2.0 * c)),
            }
            color = self._color(geom)
            shown = int(model.geom_group[geom]) < _SHOWN_GROUPS and color[3] > 0.0
            if shown and kind in kinds:
                pose = frame @ _transform(model.geom_pos[geom], model.geom_quat[geom])
                yield Shape(*kinds[kind], pose, color)

    def _color(self, geom: int) -> tuple[float, float, float, float]:
        model, material = self._model, int(self._model.geom_matid[geom])
        own = tuple(model.geom_rgba[geom].tolist())
        red, green, blue, opacity = (
            model.mat_rgba[material].tolist() if material >= 0 and own == _NO_COLOR else own
        )
        return red, green, blue, opacity

    def _joints_of(self, index: int) -> list[int]:
        first = int(self._model.body_jntadr[index])
        return [first + i for i in range(int(self._model.body_jntnum[index]))]

    def _body_name(self, index: int) -> str:
        return str(self._model.body(index).name) or f"body_{index}"

    def _joint_name(self, joint: int) -> str:
        return str(self._model.joint(joint).name) or f"joint_{joint}"

    @property
    def _joint_names(self) -> list[str]:
        return [self._joint_name(joint) for joint in range(int(self._model.njnt))]


def _vector(values: Sequence[float] | Any) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _transform(position: Sequence[float] | Any, quaternion: Sequence[float] | Any) -> Transform:
    """Return a pose, given MuJoCo's position and quaternion (w, x, y, z)."""
    w, x, y, z = (float(value) for value in quaternion)
    return Transform(_vector(position), (x, y, z, w))
