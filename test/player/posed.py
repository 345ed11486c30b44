"""Robots in some pose, and PyBullet's data about them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pybullet

from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.model import RobotState, link_poses
from pga_me_ros.player.transform import Transform
from pga_me_ros.player.urdf import urdf
from pga_me_ros.tasks.body import Body
from pga_me_ros.tasks.registry import make_task

TASKS = ("qd_walker", "qd_half_cheetah", "qd_ant", "qd_hopper")


@dataclass
class Posed:
    """A robot in the middle of an episode."""

    body: Body
    reader: BodyReader
    state: RobotState

    def centers(self) -> dict[str, Transform]:
        """Return the center of mass of each link according to our model."""
        poses = link_poses(self.reader.model, self.state)
        return {link.name: poses[link.name] @ link.center for link in self.reader.model.links[1:]}


@contextmanager
def posed(task_name: str) -> Iterator[Posed]:
    """Yield a task's robot after some steps of wild actions."""
    task: Any = make_task(task_name)
    rng = np.random.default_rng(1)
    task.reset(rng)
    for _ in range(20):
        task.step(rng.uniform(-1.0, 1.0, task.spec.action_dim).astype(np.float32))
    reader = BodyReader(task.body)
    yield Posed(task.body, reader, reader.state())
    task.close()


def centers_by_pybullet(client: int, body: int) -> dict[str, Transform]:
    """Return the center of mass of each link by name, according to PyBullet."""
    root = pybullet.getBodyInfo(body, client)[0].decode()
    found = {root: Transform(*pybullet.getBasePositionAndOrientation(body, client))}
    for index in range(pybullet.getNumJoints(body, client)):
        name = pybullet.getJointInfo(body, index, client)[12].decode()
        found[name] = Transform(*pybullet.getLinkState(body, index, 0, 1, client)[:2])
    return found


def distance(a: Transform, b: Transform) -> float:
    """Return the largest difference between the numbers of two poses; q and -q are the same rotation."""
    turned = min(
        np.abs(np.subtract(a.rotation, b.rotation)).max(),
        np.abs(np.add(a.rotation, b.rotation)).max(),
    )
    return max(np.abs(np.subtract(a.position, b.position)).max(), turned)


@contextmanager
def loaded(robot: Posed, folder: Path) -> Iterator[tuple[int, int]]:
    """Yield client and body of a robot that PyBullet loaded from our URDF, in the same pose."""
    file = folder / "robot.urdf"
    file.write_text(urdf(robot.reader.model))
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(file), physicsClientId=client)
    pybullet.resetBasePositionAndOrientation(body, *robot.state.base, physicsClientId=client)
    joints = {}
    for index in range(pybullet.getNumJoints(body, client)):
        joints[pybullet.getJointInfo(body, index, client)[1].decode()] = index
    for joint, position in zip(robot.reader.model.movable, robot.state.positions, strict=True):
        pybullet.resetJointState(body, joints[joint.name], position, 0.0, client)
    yield client, body
    pybullet.disconnect(client)
