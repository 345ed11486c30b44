"""The robots' descriptions, loaded by PyBullet and compared with the simulated robots."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
import pytest
from posed import TASKS, Posed, centers_by_pybullet, distance, loaded, posed

from pga_me_ros.errors import TaskError
from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.model import BASE_LINK
from pga_me_ros.player.transform import Transform, unit
from pga_me_ros.player.urdf import urdf
from pga_me_ros.tasks.body import Body
from pga_me_ros.tasks.registry import task_spec


@pytest.fixture(scope="module", params=TASKS)
def robot(request: pytest.FixtureRequest) -> Iterator[Posed]:
    with posed(request.param) as robot:
        yield robot


def test_links_are_where_pybullet_has_them(robot: Posed) -> None:
    truth = centers_by_pybullet(robot.body.client, robot.body.robot)
    assert {name: distance(pose, truth[name]) for name, pose in robot.centers().items()} == (
        pytest.approx(dict.fromkeys(robot.centers(), 0.0), abs=1e-9)
    )


def test_pybullet_loads_it_with_the_links_in_the_same_places(robot: Posed, tmp_path: Path) -> None:
    with loaded(robot, tmp_path) as (client, body):
        copy = centers_by_pybullet(client, body)
    assert {name: distance(pose, copy[name]) for name, pose in robot.centers().items()} == (
        pytest.approx(dict.fromkeys(robot.centers(), 0.0), abs=1e-9)
    )


def test_joints_have_the_models_names_limits_and_axes(robot: Posed) -> None:
    joints = {j.get("name"): j for j in ET.fromstring(urdf(robot.reader.model)).iter("joint")}
    for name, torque in robot.body.efforts.items():
        info = joint_info(robot.body, name)
        limit, axis = joints[name].find("limit"), joints[name].find("axis")
        assert limit is not None
        assert axis is not None
        assert [float(limit.get(k, "nan")) for k in ("lower", "upper", "effort")] == [
            *info[8:10],
            torque,
        ]
        assert numbers(axis.get("xyz", "")) == pytest.approx(unit(info[13]))


def joint_info(body: Body, name: str) -> tuple:
    infos = (
        pybullet.getJointInfo(body.robot, i, body.client)
        for i in range(pybullet.getNumJoints(body.robot, body.client))
    )
    return next(info for info in infos if info[1].decode() == name)


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def test_it_is_a_tree_with_an_empty_root(robot: Posed) -> None:
    """robot_state_publisher needs one root without inertia."""
    root = ET.fromstring(urdf(robot.reader.model))
    links = {link.get("name"): link for link in root.iter("link")}
    children = [joint.find("child").get("link") for joint in root.iter("joint")]  # type: ignore[union-attr]
    assert len(children) == len(set(children))
    assert set(links) - set(children) == {BASE_LINK}
    assert len(links[BASE_LINK]) == 0


def test_rays_hit_the_same_shapes(robot: Posed, tmp_path: Path) -> None:
    names = {
        index: name for name, index in link_indices(robot.body.client, robot.body.robot).items()
    }
    for index in names:  # the models have self-collisions switched off, which also affects rays
        pybullet.setCollisionFilterGroupMask(robot.body.robot, index, 1, 1, robot.body.client)
    starts, ends = rays(robot)
    truth = hits(robot.body.client, robot.body.robot, starts, ends)
    with loaded(robot, tmp_path) as (client, body):
        copies = {index: name for name, index in link_indices(client, body).items()}
        seen = hits(client, body, starts, ends)
    both = [(a, b) for a, b in zip(truth, seen, strict=True) if a and b]
    assert len(both) > 100
    # Grazing rays may miss one of them, and where links overlap at a joint, either may be hit first.
    assert sum(bool(a) != bool(b) for a, b in zip(truth, seen, strict=True)) < 0.03 * len(both)
    same = [(a[1], b[1]) for a, b in both if names[a[0]] == copies[b[0]]]
    assert len(same) > 0.93 * len(both)
    assert max(np.abs(np.subtract(a, b)).max() for a, b in same) < 0.015


def link_indices(client: int, body: int) -> dict[str, int]:
    found = {pybullet.getBodyInfo(body, client)[0].decode(): -1}
    for index in range(pybullet.getNumJoints(body, client)):
        found[pybullet.getJointInfo(body, index, client)[12].decode()] = index
    return found


def rays(robot: Posed, count: int = 2000) -> tuple[list, list]:
    """Return rays from all around and above toward points on the robot and next to it."""
    rng = np.random.default_rng(2)
    starts = rng.normal(size=(count, 3))
    starts *= 3.0 / np.linalg.norm(starts, axis=1, keepdims=True)
    starts[:, 2] = np.abs(starts[:, 2])
    centers = [pose.position for pose in robot.centers().values()]
    aims = np.array(centers)[rng.integers(len(centers), size=count)] + rng.normal(
        0.0, 0.1, (count, 3)
    )
    starts += robot.state.base.position
    return starts.tolist(), (starts + 1.5 * (aims - starts)).tolist()


def hits(client: int, body: int, starts: list, ends: list) -> list[tuple | None]:
    pybullet.performCollisionDetection(client)
    found = pybullet.rayTestBatch(starts, ends, physicsClientId=client)
    return [(hit[1], hit[3]) if hit[0] == body else None for hit in found]


@pytest.mark.parametrize("file", ["r2d2.urdf", "franka_panda/panda.urdf"])
def test_a_users_robot_from_urdf(file: str, tmp_path: Path) -> None:
    """These robots have rotated inertial frames, slides, boxes and meshes."""
    client = pybullet.connect(pybullet.DIRECT)
    path = f"{pybullet_data.getDataPath()}/{file}"
    body = pybullet.loadURDF(path, physicsClientId=client)
    rng = np.random.default_rng(3)
    for index in range(pybullet.getNumJoints(body, client)):
        pybullet.resetJointState(body, index, rng.uniform(-0.5, 0.5), 0.0, client)
    reader = BodyReader(Body(client, body, -1, path))
    robot = Posed(reader.body, reader, reader.state())
    truth = centers_by_pybullet(client, body)
    with loaded(robot, tmp_path) as (other, copied):
        copy = centers_by_pybullet(other, copied)
    for name, pose in robot.centers().items():
        at = truth.get(name, truth[pybullet.getBodyInfo(body, client)[0].decode()])
        assert distance(pose, at) < 1e-9, name
        assert distance(copy[name], at) < 1e-6, name
    pybullet.disconnect(client)


def test_a_robot_that_does_not_hang_on_its_torso_is_refused() -> None:
    with posed("qd_walker") as robot:
        body = robot.body
        thigh = link_indices(body.client, body.robot)["thigh"]
        with pytest.raises(TaskError, match="is not below the torso"):
            BodyReader(Body(body.client, body.robot, thigh, body.model_path))


def test_specs_and_descriptions_name_the_same_joints(robot: Posed) -> None:
    names = {f"{joint.name}/torque" for joint in robot.reader.model.movable}
    assert any(set(task_spec(task).action_names) == names for task in TASKS)


def test_base_link_is_the_torsos_center_of_mass(robot: Posed) -> None:
    truth = centers_by_pybullet(robot.body.client, robot.body.robot)
    assert distance(robot.state.base, truth["torso"]) < 1e-9
    assert robot.reader.model.joints[0].origin == Transform()
