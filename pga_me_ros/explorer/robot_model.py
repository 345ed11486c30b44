"""The robot as plain JSON: links with their shapes, meshes included, and the joints between them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pga_me_ros.errors import TaskError
from pga_me_ros.explorer.meshes import describe_mesh, read_mesh
from pga_me_ros.player.model import Link, RobotModel, Shape
from pga_me_ros.player.transform import Transform

WHITE = (1.0, 1.0, 1.0)
"""What PyBullet says of a shape to which the model gives no color; then that of the mesh's own file counts."""

SMALLEST = 0.02
"""Least edge of a box that stands for a mesh, m."""


def describe_model(model: RobotModel) -> dict[str, Any]:
    """Return a robot fit for JSON; poses are (x, y, z, quaternion).

    A mesh that cannot be read is a box of the link's mass and inertia, and ``note`` says so.
    """
    unread: dict[str, None] = {}
    links = [{"name": link.name, "shapes": _shapes(link, unread)} for link in model.links]
    note = ""
    if unread:
        note = f"Drawn as boxes of the same inertia: {', '.join(unread)}. Give these meshes as OBJ or STL files."
    return {
        "name": model.name,
        "note": note,
        "links": links,
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "parent": joint.parent,
                "child": joint.child,
                "origin": _pose(joint.origin),
                "axis": list(joint.axis),
            }
            for joint in model.joints
        ],
    }


def _shapes(link: Link, unread: dict[str, None]) -> list[dict[str, Any]]:
    """Return the shapes of a link, and note what was wrong with its meshes."""
    out: list[dict[str, Any]] = []
    for shape in link.shapes:
        if shape.kind != "mesh":
            out.append(_shape(shape))
            continue
        try:
            out += _mesh(shape)
        except TaskError as error:
            unread[str(error)] = None
            out.append(_box(link, shape))
    return out


def _shape(shape: Shape) -> dict[str, Any]:
    return {
        "kind": shape.kind,
        "size": list(shape.size),
        "pose": _pose(shape.pose),
        "color": list(shape.color),
    }


def _mesh(shape: Shape) -> list[dict[str, Any]]:
    """Return the parts of a mesh.

    Raises:
        TaskError: It cannot be read.
    """
    parts = []
    for mesh in read_mesh(Path(shape.mesh)):
        color = list(shape.color)
        if mesh.color and shape.color[:3] == WHITE:
            color = [*mesh.color, shape.color[3]]
        parts.append(_shape(shape) | {"color": color} | describe_mesh(mesh))
    return parts


def _box(link: Link, shape: Shape) -> dict[str, Any]:
    """Return the box that has the mass and the moments of inertia of a link."""
    x, y, z = link.inertia
    edges = [SMALLEST] * 3
    if link.mass > 0.0:
        squares = (6.0 * moments / link.mass for moments in (y + z - x, x + z - y, x + y - z))
        edges = [max(SMALLEST, math.sqrt(max(0.0, square))) for square in squares]
    return {
        "kind": "box",
        "size": edges,
        "pose": _pose(link.center),
        "color": list(shape.color),
    }


def _pose(pose: Transform) -> list[float]:
    return [round(x, 7) for x in (*pose.position, *pose.rotation)]
