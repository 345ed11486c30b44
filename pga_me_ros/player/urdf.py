"""Robot models as URDF, for robot_state_publisher, RViz and Foxglove."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from pga_me_ros.player.model import Color, Joint, Link, RobotModel, Shape
from pga_me_ros.player.transform import Transform, Vector, roll_pitch_yaw


def urdf(model: RobotModel) -> str:
    """Return a robot's description as URDF.

    Numbers are written with full precision. URDF has no capsules, so each becomes a cylinder and two spheres.
    """
    robot = ET.Element("robot", name=model.name)
    for color in _colors(model):
        material = ET.SubElement(robot, "material", name=_material(color))
        ET.SubElement(material, "color", rgba=_numbers(color))
    for link in model.links:
        _add_link(robot, link)
    for joint in model.joints:
        _add_joint(robot, joint)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ET.Element, link: Link) -> None:
    element = ET.SubElement(robot, "link", name=link.name)
    if link.mass > 0.0:
        inertial = ET.SubElement(element, "inertial")
        _add_origin(inertial, link.center)
        ET.SubElement(inertial, "mass", value=repr(link.mass))
        moments = dict(zip(("ixx", "iyy", "izz"), map(repr, link.inertia), strict=True))
        ET.SubElement(inertial, "inertia", moments | {"ixy": "0.0", "ixz": "0.0", "iyz": "0.0"})
    parts = [part for shape in link.shapes for part in _parts(shape)]
    for kind, part in product(("visual", "collision"), parts):
        seen = ET.SubElement(element, kind)
        _add_origin(seen, part.pose)
        _add_geometry(seen, part)
        if kind == "visual":
            ET.SubElement(seen, "material", name=_material(part.color))


def _add_geometry(element: ET.Element, shape: Shape) -> None:
    geometry = ET.SubElement(element, "geometry")
    if shape.kind == "sphere":
        ET.SubElement(geometry, "sphere", radius=repr(shape.size[0]))
    elif shape.kind == "box":
        ET.SubElement(geometry, "box", size=_numbers(shape.size))
    elif shape.kind == "cylinder":
        length, radius = map(repr, shape.size)
        ET.SubElement(geometry, "cylinder", length=length, radius=radius)
    else:
        file = Path(shape.mesh).resolve().as_uri()
        ET.SubElement(geometry, "mesh", filename=file, scale=_numbers(shape.size))


def _parts(shape: Shape) -> Iterator[Shape]:
    """Yield a shape as shapes that URDF supports."""
    if shape.kind != "capsule":
        yield shape
        return
    length, radius = shape.size
    yield Shape("cylinder", shape.size, shape.pose, shape.color)
    for end in (-0.5 * length, 0.5 * length):
        pose = shape.pose @ Transform((0.0, 0.0, end))
        yield Shape("sphere", (radius,), pose, shape.color)


def _add_joint(robot: ET.Element, joint: Joint) -> None:
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    _add_origin(element, joint.origin)
    if joint.kind == "fixed":
        return
    ET.SubElement(element, "axis", xyz=_numbers(joint.axis))
    limit = {"effort": repr(joint.effort), "velocity": repr(joint.velocity)}
    if joint.kind != "continuous":
        limit |= {"lower": repr(joint.lower), "upper": repr(joint.upper)}
    ET.SubElement(element, "limit", limit)


def _add_origin(element: ET.Element, pose: Transform) -> None:
    angles = roll_pitch_yaw(pose.rotation)
    ET.SubElement(element, "origin", xyz=_numbers(pose.position), rpy=_numbers(angles))


def _colors(model: RobotModel) -> list[Color]:
    """Return the colors in use, without duplicates."""
    shapes = (shape for link in model.links for shape in link.shapes)
    return list(dict.fromkeys(shape.color for shape in shapes))


def _material(color: Color) -> str:
    return "color_" + "".join(f"{round(255 * value):02x}" for value in color)


def _numbers(values: tuple[float, ...] | Vector) -> str:
    return " ".join(repr(float(value)) for value in values)
