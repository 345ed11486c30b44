"""Poses of capsules in MuJoCo models: PyBullet simulates them correctly, but does not report them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from pga_me_ros.errors import TaskError
from pga_me_ros.player.transform import Transform, Vector, from_z_to


def capsule_poses(path: Path) -> dict[str, list[Transform | None]]:
    """Return the poses of the capsules that a model gives by their two ends.

    Args:
        path: MJCF file.

    Returns:
        By body name, an entry per geom in the file's order: the pose in the body's frame of the capsule, which lies
        along z; None for a geom that is given in another way.

    Raises:
        TaskError: The file is missing or not valid MJCF.
    """
    try:
        root = ET.parse(path).getroot()
        return {
            body.get("name", ""): [_pose(geom) for geom in body.findall("geom")]
            for body in root.iter("body")
        }
    except (OSError, ET.ParseError, ValueError) as error:
        raise TaskError(
            f"the robot's model '{path}' cannot be read as MJCF ({error}); a task's body.model_path names the file "
            "that the robot was loaded from"
        ) from error


def _pose(geom: ET.Element) -> Transform | None:
    ends = geom.get("fromto")
    if ends is None:
        return None
    x0, y0, z0, x1, y1, z1 = (float(word) for word in ends.split())
    middle: Vector = ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)
    return Transform(middle, from_z_to((x1 - x0, y1 - y0, z1 - z0)))
