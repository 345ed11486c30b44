"""The fields of sensor messages that an observation may be made of, by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray

from pga_me_ros.errors import PgaError
from pga_me_ros.player.transform import (
    Quaternion,
    Vector,
    conjugate,
    roll_pitch_yaw,
    rotate,
    turn,
)

Read = Callable[[Any], float]


class UnusableError(PgaError):
    """A message does not say what the mapping takes from it: its readings grow old."""


UNIT = 1e-3
"""How far the length of an orientation's quaternion may be from 1."""

UNKNOWN = -1.0
"""First entry of a covariance of sensor_msgs/Imu where the sensor does not measure the quantity."""

TYPES: Mapping[str, type] = {
    "sensor_msgs/JointState": JointState,
    "sensor_msgs/Imu": Imu,
    "nav_msgs/Odometry": Odometry,
    "std_msgs/Bool": Bool,
    "std_msgs/Float64": Float64,
    "std_msgs/Float64MultiArray": Float64MultiArray,
}
"""Types of messages by name."""

JOINTS, ARRAY = "sensor_msgs/JointState", "std_msgs/Float64MultiArray"

_UP: Vector = (0.0, 0.0, 1.0)


def quaternion(q: Any) -> Quaternion:
    """Return a geometry_msgs/Quaternion as numbers.

    Raises:
        UnusableError: It is no rotation. All zero, as from a sensor without orientation, it would read as level.
    """
    length = math.hypot(q.x, q.y, q.z, q.w)
    if abs(length - 1.0) > UNIT:
        raise UnusableError(f"its orientation has length {length:.3g} instead of 1")
    return (q.x, q.y, q.z, q.w)


def _measured(msg: Imu, quantity: str) -> Any:
    """Return a quantity of an Imu message.

    Raises:
        UnusableError: The sensor does not measure it.
    """
    if getattr(msg, f"{quantity}_covariance")[0] == UNKNOWN:
        raise UnusableError(f"its sensor measures no {quantity} ({quantity}_covariance[0] is -1)")
    return getattr(msg, quantity)


def _heading_velocity(msg: Odometry) -> Vector:
    """Return the velocity of the base along its heading, to the left and up, m/s."""
    rotation = quaternion(msg.pose.pose.orientation)
    v = msg.twist.twist.linear
    yaw = roll_pitch_yaw(rotation)[2]
    return rotate(conjugate(turn(_UP, yaw)), rotate(rotation, (v.x, v.y, v.z)))


def _angles(orientation: Callable[[Any], Any]) -> dict[str, Read]:
    def angle(axis: int) -> Read:
        return lambda msg: roll_pitch_yaw(quaternion(orientation(msg)))[axis]

    return {name: angle(axis) for axis, name in enumerate(("roll", "pitch", "yaw"))}


def _axes(prefix: str, vector: Callable[[Any], Any]) -> dict[str, Read]:
    def entry(axis: str) -> Read:
        return lambda msg: getattr(vector(msg), axis)

    return {f"{prefix}.{axis}": entry(axis) for axis in "xyz"}


FIELDS: Mapping[str, Mapping[str, Read]] = {
    "sensor_msgs/Imu": {
        **_angles(lambda msg: _measured(msg, "orientation")),
        **_axes("angular_velocity", lambda msg: _measured(msg, "angular_velocity")),
        **_axes("linear_acceleration", lambda msg: _measured(msg, "linear_acceleration")),
    },
    "nav_msgs/Odometry": {
        **_axes("position", lambda msg: msg.pose.pose.position),
        **_angles(lambda msg: msg.pose.pose.orientation),
        "velocity.forward": lambda msg: _heading_velocity(msg)[0],
        "velocity.left": lambda msg: _heading_velocity(msg)[1],
        "velocity.up": lambda msg: _heading_velocity(msg)[2],
        **_axes("linear_velocity", lambda msg: msg.twist.twist.linear),
        **_axes("angular_velocity", lambda msg: msg.twist.twist.angular),
    },
    "std_msgs/Bool": {"data": lambda msg: float(msg.data)},
    "std_msgs/Float64": {"data": lambda msg: msg.data},
}
"""What each type of message tells, by the name of the field; joints and arrays are in `Observer`.

Angles are roll, pitch and yaw about fixed axes, rad. ``velocity`` is along the heading of the base, to its left, and
up; ``linear_velocity`` is in the axes of the base, as nav_msgs has it.
"""

JOINT_FIELDS = ("position", "velocity", "effort")


def field_names(kind: str) -> tuple[str, ...]:
    """Return the names of the fields of a type of message."""
    if kind == JOINTS:
        return JOINT_FIELDS
    return ("data",) if kind == ARRAY else tuple(FIELDS[kind])
