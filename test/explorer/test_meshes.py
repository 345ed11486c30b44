"""Robots whose shapes are meshes: read from their files as PyBullet places them, and drawn on the page."""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pytest

from pga_me_ros.errors import TaskError
from pga_me_ros.explorer.meshes import Mesh, coarser, read_mesh
from pga_me_ros.explorer.robot_model import describe_model
from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.model import RobotModel
from pga_me_ros.tasks.body import Body

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])

OBJ = """\
mtllib paint.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 2
usemtl red
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl green
f 1 2 -1
f 2 3 5
"""
MTL = "newmtl red\nKd 0.9 0.1 0.2\nnewmtl green\nKa 1 1 1\nKd 0.1 0.8 0.3\n"

URDF = """\
<robot name="bot">
  <link name="trunk">
    <inertial><mass value="3"/><inertia ixx="0.05" iyy="0.1" izz="0.13" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.1"/><geometry><mesh filename="pyramid.obj" scale="0.2 0.2 0.1"/></geometry></visual>
  </link>
  <link name="arm">
    <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual>
      <geometry><mesh filename="wedge.stl" scale="0.3 0.3 0.3"/></geometry>
      <material name="blue"><color rgba="0.1 0.2 0.9 1"/></material>
    </visual>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="trunk"/><child link="arm"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""


def binary_stl() -> bytes:
    rows = [
        struct.pack("<12fH", 0.0, 0.0, 0.0, *CORNERS[face].ravel().tolist(), 0) for face in FACES
    ]
    return b"solid, but binary".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def text_stl() -> str:
    facets = [
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in CORNERS[face].tolist())
        + " endloop\nendfacet\n"
        for face in FACES
    ]
    return f"solid wedge\n{''.join(facets)}endsolid wedge\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "pyramid.obj").write_text(OBJ)
    (tmp_path / "paint.mtl").write_text(MTL)
    (tmp_path / "wedge.stl").write_bytes(binary_stl())
    (tmp_path / "bot.urdf").write_text(URDF)
    return tmp_path


@pytest.fixture
def model(folder: Path) -> Iterator[RobotModel]:
    """Return the robot as PyBullet has loaded it."""
    client = pybullet.connect(pybullet.DIRECT)
    file = str(folder / "bot.urdf")
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    robot = pybullet.loadURDF(file, flags=flags, physicsClientId=client)
    yield BodyReader(Body(client, robot, model_path=file)).model
    pybullet.disconnect(client)


def corners(shape: dict[str, Any]) -> np.ndarray:
    """Return the (triangles, 3, 3) corners of a described mesh."""
    vertices = np.frombuffer(base64.b64decode(shape["vertices"]), "<f4").reshape(-1, 3)
    return vertices[np.frombuffer(base64.b64decode(shape["triangles"]), "<u4").reshape(-1, 3)]


def in_order(triangles: np.ndarray) -> list[Any]:
    return sorted(sorted(t) for t in triangles.tolist())


@pytest.mark.parametrize("content", [binary_stl(), text_stl().encode()], ids=["binary", "text"])
def test_stl_files_are_read(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "wedge.STL").write_bytes(content)
    (mesh,) = read_mesh(tmp_path / "wedge.STL")
    assert (len(mesh.vertices), mesh.color) == (4, None)
    assert in_order(mesh.vertices[mesh.triangles]) == in_order(CORNERS[FACES])


def test_obj_files_have_a_part_per_material(folder: Path) -> None:
    red, green = read_mesh(folder / "pyramid.obj")
    assert (red.color, len(red.triangles)) == ((0.9, 0.1, 0.2), 2)  # a square
    assert (green.color, len(green.triangles)) == ((0.1, 0.8, 0.3), 2)
    assert green.vertices[green.triangles].max() == 2.0  # the newest vertex, as -1 and as 5


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("hull.dae", "<COLLADA/>", "is neither OBJ nor STL"),
        ("hull.obj", "v 0 0 zero\n", "cannot be read"),
        ("hull.obj", "v 0 0 0\nf 1 2 3\n", "a vertex that is not there"),
        ("hull.obj", "v 0 0 0\n", "has no triangles"),
        ("hull.stl", "solid\nvertex 0 0 nan\nvertex 1 0 0\nvertex 0 1 0\n", "not finite"),
        ("hull.stl", "solid\nvertex 0 0 0\n", "cannot be read"),
    ],
)
def test_what_is_no_mesh_is_told(tmp_path: Path, name: str, content: str, words: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(TaskError, match=words):
        read_mesh(tmp_path / name)


def test_a_mesh_that_is_too_fine_becomes_coarser() -> None:
    n = 60
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    vertices = np.stack([u, v, 0.1 * np.sin(6 * u)], axis=-1).reshape(-1, 3)
    i = np.arange(n * n).reshape(n, n)
    halves = [(i[:-1, :-1], i[1:, :-1], i[1:, 1:]), (i[:-1, :-1], i[1:, 1:], i[:-1, 1:])]
    triangles = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    out = coarser(Mesh(vertices, triangles), 1000)
    assert 300 < len(out.triangles) <= 1000
    assert np.abs(out.vertices.max(axis=0) - vertices.max(axis=0)).max() < 0.05


def test_the_page_draws_meshes_where_the_simulator_has_them(
    model: RobotModel, hopper_page: Any
) -> None:
    robot = describe_model(model)
    assert robot["note"] == ""
    shapes = [shape for link in robot["links"] for shape in link["shapes"]]
    assert [shape["color"][:3] for shape in shapes] == [
        [0.9, 0.1, 0.2],
        [0.1, 0.8, 0.3],
        pytest.approx([0.1, 0.2, 0.9]),
    ]
    assert corners(shapes[0]).shape == (2, 3, 3)
    low, high = hopper_page.eval(
        """(model) => {
            const robot = Robot.build(model, []);
            robot.group.updateMatrixWorld(true);
            const box = new THREE.Box3().setFromObject(robot.group);
            return [box.min.toArray(), box.max.toArray()];
        }""",
        robot,
    )
    # The pyramid is 0.2 x 0.2 x 0.2 m from z = 0.1 on, the wedge 0.3 m from x = 0.4 on.
    assert low == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert high == pytest.approx([0.7, 0.3, 0.3], abs=1e-6)
    assert hopper_page.problems == []


def test_a_mesh_that_cannot_be_read_is_a_box_of_the_same_inertia(
    folder: Path, model: RobotModel
) -> None:
    (folder / "wedge.stl").unlink()
    robot = describe_model(model)
    (box,) = robot["links"][-1]["shapes"]
    assert robot["note"].startswith("Drawn as boxes of the same inertia: 'wedge.stl' cannot be")
    edges = np.array(box["size"])
    assert box["kind"] == "box"
    assert (edges @ edges - edges**2) / 12 == pytest.approx(0.1)  # m (y² + z²) / 12 = 0.1
