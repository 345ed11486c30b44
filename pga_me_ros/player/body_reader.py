"""Reads a robot from PyBullet: its model once, its state after each step, without changing the simulation."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from pga_me_ros.errors import TaskError
from pga_me_ros.player.mjcf import capsule_poses
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
from pga_me_ros.player.transform import ZERO, Transform, conjugate, multiply, rotate, unit
from pga_me_ros.tasks.body import Body

_MADE_UP = re.compile(r"jointfix_\d+_\d+")
"""Names that PyBullet gives to the welds of MJCF models; their numbers depend on what was loaded before."""

_KINDS = {0: "revolute", 1: "prismatic", 4: "fixed"}
_SHAPES = {2: ("sphere", 1), 3: ("box", 3), 4: ("cylinder", 2), 5: ("mesh", 3), 7: ("capsule", 2)}


class BodyReader:
    """Reads one robot.

    Poses are computed from the joint positions: reading link poses from PyBullet may refresh its caches, which would
    change the episode.

    Args:
        body: The robot in its world, which must stay open.

    Attributes:
        body: The robot in its world.
        model: The robot's links and joints.
        client: Id of the PyBullet client.

    Raises:
        TaskError: The robot is not a tree of links below the torso with joints of one degree of freedom.
    """

    def __init__(self, body: Body) -> None:
        import pybullet

        self._pybullet = pybullet
        self.body = body
        self.client = body.client
        self._path = Path(os.fspath(body.model_path))
        self._infos = [
            pybullet.getJointInfo(body.robot, index, body.client)
            for index in range(pybullet.getNumJoints(body.robot, body.client))
        ]
        self._joint_names = {info[1].decode() for info in self._infos}
        self._dynamics = {
            index: pybullet.getDynamicsInfo(body.robot, index, body.client)
            for index in range(-1, len(self._infos))
        }
        self._centers = {index: Transform(*d[3:5]) for index, d in self._dynamics.items()}
        self._rails = self._ancestors(body.torso)
        self._shapes = self._read_shapes()
        self.model = self._read_model()
        self._movable = [joint.index for joint in self.model.movable]

    def state(self) -> RobotState:
        """Return where the robot is now."""
        pybullet, body = self._pybullet, self.body
        states = pybullet.getJointStates(body.robot, self._movable, body.client)
        pose = told = Transform(*pybullet.getBasePositionAndOrientation(body.robot, body.client))
        if body.torso < 0:
            linear, angular = pybullet.getBaseVelocity(body.robot, body.client)
        else:
            link = pybullet.getLinkState(body.robot, body.torso, 1, 0, body.client)
            told, (linear, angular) = Transform(*link[:2]), link[6:8]
            pose = self._along_rails(pose @ self._centers[-1].inverse())
        positions, velocities = tuple(s[0] for s in states), tuple(s[1] for s in states)
        return RobotState(pose, linear, angular, positions, velocities, told)

    def _along_rails(self, pose: Transform) -> Transform:
        """Return the pose of the torso's center of mass, given that of the base's frame."""
        pybullet, body = self._pybullet, self.body
        for index in self._rails:
            pose = pose @ self._origin(index)
            if self._kind(index) != "fixed":
                state = pybullet.getJointState(body.robot, index, body.client)
                pose = pose @ motion(self._kind(index), self._axis(index), state[0])
        return pose @ self._centers[body.torso]

    def _read_model(self) -> RobotModel:
        root, robot = self._pybullet.getBodyInfo(self.body.robot, self.body.client)
        torso = self.body.torso
        torso_name = root.decode() if torso < 0 else self._name(torso)
        # The user's links and joints keep their names; what is added here gets a free one.
        below = {torso_name, *map(self._name, self._below_torso())}
        base = free_name(below, BASE_LINK, TORSO_CENTER)
        names = {torso: torso_name}
        # The torso's own frame may be anywhere (a walker's is on the floor), so its center of mass is the reference.
        frames = {torso: self._centers[torso].inverse()}
        links = [
            Link(base, 0.0, ZERO, Transform(), ()),
            self._link(torso, torso_name, frames[torso]),
        ]
        weld = free_name(self._joint_names, f"{base}_to_{torso_name}")
        joints = [Joint(weld, "fixed", base, torso_name, Transform())]
        for index in self._below_torso():
            if index in names:
                continue  # it was merged into the previous link
            # PyBullet turns a body with several joints, or with an offset joint, into a chain of empty links.
            part = self._welded_to_nothing(index)
            frames[index], names[index] = Transform(), self._name(part)
            if part != index:
                frames[part], names[part] = self._origin(part), self._name(part)
            parent = self._infos[index][16]
            joints.append(self._joint(index, names[parent], names[part], frames[parent]))
            links.append(self._link(part, names[part], frames[part]))
        return RobotModel(robot.decode() or "robot", tuple(links), tuple(joints))

    def _link(self, index: int, name: str, frame: Transform) -> Link:
        """Return a link, given the pose of its PyBullet frame in the frame that we give it."""
        mass, _, inertia = self._dynamics[index][:3]
        shapes = tuple(
            Shape(s.kind, s.size, frame @ s.pose, s.color, s.mesh)
            for s in self._shapes.get(index, [])
        )
        return Link(name, mass, inertia, frame @ self._centers[index], shapes)

    def _joint(self, index: int, parent: str, child: str, frame: Transform) -> Joint:
        info = self._infos[index]
        name, kind, (lower, upper, effort, velocity) = (
            info[1].decode(),
            self._kind(index),
            info[8:12],
        )
        origin = frame @ self._origin(index)
        if kind == "fixed":
            if _MADE_UP.fullmatch(name):
                name = free_name(self._joint_names, f"{parent}_to_{child}")
            return Joint(name, kind, parent, child, origin)
        if lower > upper:
            if kind == "prismatic":
                raise TaskError(
                    f"joint '{name}' slides without limits, which URDF cannot express; give it limits, or name a torso "
                    "below it in the task's body"
                )
            kind, lower, upper = "continuous", 0.0, 0.0
        effort = self.body.efforts.get(name, effort)
        velocity = velocity or NO_SPEED_LIMIT
        return Joint(
            name,
            kind,
            parent,
            child,
            origin,
            self._axis(index),
            lower,
            upper,
            effort,
            velocity,
            index,
        )

    def _welded_to_nothing(self, index: int) -> int:
        """Return the one link that is welded to an empty link (no mass, no shape), else the link itself."""
        children = [i for i, info in enumerate(self._infos) if info[16] == index]
        empty = self._dynamics[index][0] == 0.0 and index not in self._shapes
        welds = [_MADE_UP.fullmatch(self._infos[i][1].decode()) for i in children]
        return children[0] if empty and len(welds) == 1 and welds[0] else index

    def _below_torso(self) -> Iterator[int]:
        """Yield the links below the torso, parents first.

        Raises:
            TaskError: A link is not below the torso.
        """
        below = {self.body.torso}
        for index, info in enumerate(self._infos):
            if info[16] in below:
                below.add(index)
                yield index
            elif index not in self._rails:
                raise TaskError(
                    f"link '{self._name(index)}' is not below the torso; the torso of a task's body must be an "
                    "ancestor of all other links"
                )

    def _ancestors(self, index: int) -> list[int]:
        """Return the joints that lead from the base to a link."""
        path: list[int] = []
        while index >= 0:
            path.insert(0, index)
            index = self._infos[index][16]
        return path

    def _read_shapes(self) -> dict[int, list[Shape]]:
        """Return the shapes of each link in its PyBullet frame."""
        shapes: dict[int, list[Shape]] = {}
        for data in self._pybullet.getVisualShapeData(self.body.robot, -1, self.body.client):
            if data[2] not in _SHAPES:
                raise TaskError(
                    f"a shape of kind {data[2]} in '{self._path}' cannot be drawn; expected sphere, box, "
                    "cylinder, capsule or mesh"
                )
            if data[7][3] == 0.0:
                continue  # invisible, such as a part removed by damage
            kind, entries = _SHAPES[data[2]]
            pose, mesh = Transform(*data[5:7]), data[4].decode()
            shapes.setdefault(data[1], []).append(
                Shape(kind, tuple(data[3][:entries]), pose, data[7], mesh)
            )
        if self._path.suffix.lower() in (".xml", ".mjcf"):
            self._lay_capsules(shapes)
        return shapes

    def _lay_capsules(self, shapes: dict[int, list[Shape]]) -> None:
        """Correct the poses of capsules given by their ends, which PyBullet reports as upright at the origin."""
        poses = capsule_poses(self._path)
        root = self._pybullet.getBodyInfo(self.body.robot, self.body.client)[0].decode()
        for index, seen in shapes.items():
            known = poses.get(root if index < 0 else self._name(index), [])
            if len(known) == len(seen):
                shapes[index] = [
                    Shape(s.kind, s.size, pose or s.pose, s.color, s.mesh)
                    for s, pose in zip(seen, known, strict=True)
                ]

    def _name(self, index: int) -> str:
        return str(self._infos[index][12].decode())

    def _kind(self, index: int) -> str:
        kind = _KINDS.get(self._infos[index][2])
        if kind is None:
            name = self._infos[index][1].decode()
            raise TaskError(
                f"joint '{name}' has several degrees of freedom; only robots with hinges and slides can be shown"
            )
        return kind

    def _origin(self, index: int) -> Transform:
        """Return the pose of a link's frame in that of its parent at position 0.

        PyBullet gives the joint's position in the frame of the parent's center of mass, and the inverse of the rotation
        between the frames of the two centers of mass.
        """
        info = self._infos[index]
        turned = multiply(conjugate(info[15]), conjugate(self._centers[index].rotation))
        return self._centers[info[16]] @ Transform(info[14], turned)

    def _axis(self, index: int) -> tuple[float, float, float]:
        return unit(rotate(self._centers[index].rotation, self._infos[index][13]))
