"""Links, joints and frames keep the names of the user's model; added ones get free names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote, urlparse

import pybullet
import pybullet_data
import pytest
from posed import Posed, centers_by_pybullet, distance, loaded

from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.messages import RobotMessages, stamp_of
from pga_me_ros.player.model import RobotModel, RobotState
from pga_me_ros.player.urdf import urdf
from pga_me_ros.tasks.body import Body

DATA = Path(pybullet_data.getDataPath())
ROBOTS = (
    "r2d2.urdf",
    "husky/husky.urdf",
    "laikago/laikago.urdf",
    "kuka_iiwa/model.urdf",
    "racecar/racecar.urdf",
    "quadruped/minitaur.urdf",
    "franka_panda/panda.urdf",
    "xarm/xarm6_robot.urdf",
)
LEG = """
  <link name="{leg}">
    <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry>{shape}</geometry></visual>
  </link>
  <joint name="{joint}" type="revolute">
    <parent link="{body}"/><child link="{leg}"/><origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="10" velocity="5"/>
  </joint>
"""
FIXED = """
  <link name="{root}"/>
  <link name="{body}">
    <inertial>
      <origin xyz="0.05 0 0.1"/><mass value="1"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><box size="0.3 0.2 0.1"/></geometry></visual>
  </link>
  <joint name="{weld}" type="fixed"><parent link="{root}"/><child link="{body}"/><origin xyz="0 0 0.3"/></joint>
"""
BOX = '<box size="0.3 0.2 0.1"/>'


def robot_of(root: str, body: str, weld: str = "weld", leg: str = "leg", shape: str = BOX) -> str:
    """Return a URDF: an empty root, a body welded to it, and a leg."""
    rest = LEG.format(leg=leg, shape=shape, joint="hip", body=body)
    return f'<robot name="bot">{FIXED.format(root=root, body=body, weld=weld)}{rest}</robot>'


@contextmanager
def read(path: Path, **of_body: object) -> Iterator[Posed]:
    client = pybullet.connect(pybullet.DIRECT)
    robot = pybullet.loadURDF(str(path), physicsClientId=client)
    body = Body(client, robot, -1, **{"model_path": str(path), **of_body})
    reader = BodyReader(body)
    yield Posed(body, reader, reader.state())
    pybullet.disconnect(client)


def tree_of(model: RobotModel, state: RobotState) -> dict[str, str]:
    """Return the parent of each frame in /tf and /tf_static; each must have only one, without loops."""
    messages = RobotMessages(model)
    sent = [*messages.moving_frames(state, stamp_of(0)).transforms]
    sent += messages.fixed_frames(stamp_of(0)).transforms
    children = [t.child_frame_id for t in sent]
    assert len(children) == len(set(children))
    parents = {t.child_frame_id: t.header.frame_id for t in sent}
    for child in children:
        path = [child]
        while path[-1] in parents:
            path.append(parents[path[-1]])
            assert path.count(path[-1]) == 1
        assert path[-1] == model.world
    return parents


def names(source: ET.Element, kind: str) -> list[str]:
    return [element.get("name", "") for element in source.findall(kind)]


@pytest.mark.parametrize("file", ROBOTS)
def test_robots_keep_all_names_and_gain_one_link_and_one_joint(file: str, tmp_path: Path) -> None:
    source = ET.parse(DATA / file).getroot()
    with read(DATA / file) as robot:
        model = robot.reader.model
        made = ET.fromstring(urdf(model))
        for kind in ("link", "joint"):
            assert len(names(made, kind)) == len(set(names(made, kind)))
            (added,) = set(names(made, kind)) - set(names(source, kind))
            assert set(names(source, kind)) == set(names(made, kind)) - {added}
        tree_of(model, robot.state)
        truth = centers_by_pybullet(robot.body.client, robot.body.robot)
        for name, pose in robot.centers().items():
            assert distance(pose, truth[name]) < 1e-9, name
        meshes = [Path(unquote(urlparse(m.get("filename", "")).path)) for m in made.iter("mesh")]
        assert all(mesh.is_file() for mesh in meshes)


@pytest.mark.parametrize(
    ("root", "body", "base", "world"),
    [
        ("base_footprint", "base_link", "torso_center", "odom"),
        ("base_link", "chassis", "torso_center", "odom"),
        ("world", "base_link", "torso_center", "odom"),
        ("world", "torso_center", "base_link", "odom"),
        ("base_link", "torso_center", "torso_center_2", "odom"),
        ("odom", "base", "base_link", "odom_2"),
        ("chassis", "cabin", "base_link", "odom"),
    ],
)
def test_added_frames_get_free_names(
    tmp_path: Path, root: str, body: str, base: str, world: str
) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(robot_of(root, body))
    with read(path) as robot:
        model = robot.reader.model
        assert (model.base, model.world) == (base, world)
        assert {link.name for link in model.links} == {base, root, body, "leg"}
        assert tree_of(model, robot.state) == {base: world, root: base, body: root, "leg": body}
        odometry = RobotMessages(model, "left/").odometry(robot.state, stamp_of(0))
        assert (odometry.header.frame_id, odometry.child_frame_id) == (
            f"left/{world}",
            f"left/{base}",
        )
        with loaded(robot, tmp_path) as (client, copied):
            copy = centers_by_pybullet(client, copied)
        for name, pose in robot.centers().items():
            assert distance(pose, copy[name]) < 1e-6, name


def test_the_added_joint_gets_a_free_name(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(robot_of("chassis", "cabin", weld="base_link_to_chassis"))
    with read(path) as robot:
        added, *own = [joint.name for joint in robot.reader.model.joints]
    assert added == "base_link_to_chassis_2"
    assert sorted(own) == ["base_link_to_chassis", "hip"]


@pytest.mark.parametrize("folder", [".", "with space", "50 % äöü #1"])
@pytest.mark.parametrize("suffix", [".urdf", ".URDF", ".xml", ""])
@pytest.mark.parametrize("relative", [False, True])
def test_model_paths_of_every_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, suffix: str, relative: bool
) -> None:
    home = tmp_path / folder
    home.mkdir(exist_ok=True)
    (home / "leg.obj").write_text((DATA / "cube.obj").read_text())
    path = home / f"robot{suffix}"
    path.write_text(robot_of("base_link", "chassis", shape='<mesh filename="leg.obj"/>'))
    monkeypatch.chdir(tmp_path)
    for given in (str, Path):
        with read(path.relative_to(tmp_path) if relative else path) as robot:
            body = Body(robot.body.client, robot.body.robot, -1, given(path))
            made = ET.fromstring(urdf(BodyReader(body).model))
        (mesh,) = {m.get("filename", "") for m in made.iter("mesh")}
        assert Path(unquote(urlparse(mesh).path)) == home.resolve() / "leg.obj"


def test_names_with_xml_characters_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(robot_of("a &amp; b", "cab &quot;in&quot;", leg="Fuß"))
    with read(path) as robot:
        made = ET.fromstring(urdf(robot.reader.model))
    assert set(names(made, "link")) == {"base_link", "a & b", 'cab "in"', "Fuß"}
