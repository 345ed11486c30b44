"""MuJoCo's robots as models: poses and speeds equal MuJoCo's own, and reading changes nothing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
import pytest

from pga_me_ros.errors import TaskError
from pga_me_ros.player.model import RobotState, link_poses
from pga_me_ros.player.mujoco_reader import MujocoReader
from pga_me_ros.player.transform import Transform, rotate
from pga_me_ros.player.urdf import urdf
from pga_me_ros.player.watched_rollout import record
from pga_me_ros.tasks.body import MujocoBody
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import rollout

ROBOTS = ("Walker2d-v5", "HalfCheetah-v5", "Ant-v5", "Hopper-v5")

BALL = """
<mujoco>
  <worldbody>
    <body name="trunk">
      <freejoint/>
      <geom size=".1"/>
      <body pos="0 0 .3"><joint name="shoulder" type="ball"/><geom size=".1"/></body>
    </body>
  </worldbody>
</mujoco>
"""

ODD = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="trunk" pos="0 0 1" euler="10 20 30">
      <freejoint/>
      <geom type="box" size=".1 .2 .3" pos=".02 0 0"/>
      <body name="arm" pos=".1 0 .2" euler="0 40 0">
        <joint name="lift" type="slide" axis="0 0 1" pos=".01 .02 .03" range="0 1" limited="true"/>
        <joint name="shoulder" axis="0 1 0" pos=".05 0 .1" ref="30" range="-90 90" limited="true"/>
        <joint name="roll" axis="1 0 0" pos="0 .04 0"/>
        <geom type="cylinder" size=".02 .2"/>
        <body pos="0 0 .3"><geom type="sphere" size=".05" pos=".1 0 0" euler="30 0 0"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A body with three joints, one with a reference angle, anchors beside the frames, a weld and a nameless body."""


@contextmanager
def swinging(name: str) -> Iterator[MujocoBody]:
    """Yield a task's robot in the middle of an episode."""
    task: Any = make_task(f"gymnasium:{name}")
    rng = np.random.default_rng(0)
    task.reset(rng)
    for _ in range(10):
        task.step(rng.uniform(-1.0, 1.0, task.spec.action_dim).astype(np.float32))
    yield task.body
    task.close()


def truth_of(body: MujocoBody) -> Any:
    """Return what MuJoCo computes for the present positions and speeds."""
    truth = mujoco.MjData(body.model)
    truth.qpos[:], truth.qvel[:] = body.data.qpos, body.data.qvel
    mujoco.mj_forward(body.model, truth)
    return truth


def assert_equal_poses(body: MujocoBody, reader: MujocoReader, state: RobotState) -> None:
    """Compare every link and shape with MuJoCo's bodies and geoms."""
    truth, poses = truth_of(body), link_poses(reader.model, state)
    compared = 0
    for link in reader.model.links[1:]:
        index = mujoco.mj_name2id(body.model, mujoco.mjtObj.mjOBJ_BODY, link.name)
        if index < 0 and link.name.startswith("body_"):
            index = int(link.name.removeprefix("body_"))
        if index < 0:
            assert link.mass == 0.0  # between two joints of one body
            continue
        center = poses[link.name] @ link.center
        np.testing.assert_allclose(center.position, truth.xipos[index], atol=1e-12)
        geoms = body.model.body_geomadr[index] + np.arange(body.model.body_geomnum[index])
        for geom, shape in zip(geoms, link.shapes, strict=True):
            pose: Transform = poses[link.name] @ shape.pose
            matrix = truth.geom_xmat[geom].reshape(3, 3)
            np.testing.assert_allclose(pose.position, truth.geom_xpos[geom], atol=1e-12)
            for column, axis in enumerate(np.eye(3).tolist()):
                turned = rotate(pose.rotation, tuple(axis))
                np.testing.assert_allclose(turned, matrix[:, column], atol=1e-12)
            compared += 1
    assert compared


@pytest.mark.parametrize("name", ROBOTS)
def test_links_and_shapes_are_where_mujoco_has_them(name: str) -> None:
    with swinging(name) as body:
        reader = MujocoReader(body)
        assert_equal_poses(body, reader, reader.state())


def test_several_joints_of_a_body_and_references_are_understood() -> None:
    model = mujoco.MjModel.from_xml_string(ODD)
    data = mujoco.MjData(model)
    data.qpos[7:] = (0.3, 0.9, -0.7)
    data.qvel[:] = np.linspace(-1.0, 1.0, model.nv)
    body = MujocoBody(model, data)
    reader = MujocoReader(body)
    state = reader.state()
    assert [joint.name for joint in reader.model.movable] == ["lift", "shoulder", "roll"]
    assert state.positions == (0.3, 0.9, -0.7)
    assert_equal_poses(body, reader, state)
    assert "body_3" in urdf(reader.model)


@pytest.mark.parametrize("name", ["Ant-v5", "Walker2d-v5"])
def test_the_speed_of_the_base_is_how_fast_it_moves(name: str) -> None:
    with swinging(name) as body:
        reader = MujocoReader(body)
        before = reader.state()
        step = 1e-6
        mujoco.mj_integratePos(body.model, body.data.qpos, body.data.qvel, step)
        after = reader.state()
        moved = np.subtract(after.base.position, before.base.position) / step
        np.testing.assert_allclose(before.linear, moved, atol=1e-4)
        for axis in np.eye(3).tolist():
            ends = [np.array(rotate(s.base.rotation, tuple(axis))) for s in (before, after)]
            turned = (ends[1] - ends[0]) / step
            np.testing.assert_allclose(np.cross(before.angular, ends[0]), turned, atol=1e-3)


def test_watching_changes_no_bit() -> None:
    task = make_task("gymnasium:Hopper-v5")

    def act(observation: np.ndarray) -> np.ndarray:
        return np.tanh(observation[:3])

    alone = rollout(task, act, np.random.default_rng(4))
    watched = record(task, act, np.random.default_rng(4))
    task.close()
    assert np.array_equal(watched.episode.states, alone.states)
    assert np.array_equal(watched.episode.descriptor, alone.descriptor)
    assert len(watched.states) == alone.length + 1


def test_a_ball_joint_is_named() -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    with pytest.raises(TaskError, match="'shoulder' has several degrees of freedom"):
        MujocoReader(MujocoBody(model, mujoco.MjData(model)))
