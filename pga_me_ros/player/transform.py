"""Positions and rotations in plain floats, which are faster than arrays for a few links per step."""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)
UNTURNED: Quaternion = (0.0, 0.0, 0.0, 1.0)


class Transform(NamedTuple):
    """Pose of one frame in another: a point p of the inner one lies at position + rotation p of the outer one.

    Attributes:
        position: Origin of the inner frame, m.
        rotation: Unit quaternion (x, y, z, w).
    """

    position: Vector = ZERO
    rotation: Quaternion = UNTURNED

    def __matmul__(self, inner: Transform) -> Transform:
        """Return the composed pose: a frame given in the inner frame, expressed in the outer frame."""
        return Transform(self.apply(inner.position), multiply(self.rotation, inner.rotation))

    def apply(self, point: Vector) -> Vector:
        """Return a point of the inner frame in coordinates of the outer one."""
        x, y, z = rotate(self.rotation, point)
        return (self.position[0] + x, self.position[1] + y, self.position[2] + z)

    def inverse(self) -> Transform:
        """Return the pose of the outer frame in the inner one."""
        back = conjugate(self.rotation)
        x, y, z = rotate(back, self.position)
        return Transform((-x, -y, -z), back)


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse rotation."""
    return (-q[0], -q[1], -q[2], q[3])


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return a rotated vector."""
    x, y, z, _ = multiply(multiply(q, (v[0], v[1], v[2], 0.0)), conjugate(q))
    return (x, y, z)


def turn(axis: Vector, angle: float) -> Quaternion:
    """Return the rotation about a unit axis by an angle, rad."""
    sine = math.sin(0.5 * angle)
    return (axis[0] * sine, axis[1] * sine, axis[2] * sine, math.cos(0.5 * angle))


def unit(v: Vector) -> Vector:
    """Return a vector of length 1 in the same direction; a zero vector is returned unchanged."""
    length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return (v[0] / length, v[1] / length, v[2] / length) if length else v


def from_z_to(direction: Vector) -> Quaternion:
    """Return the shortest rotation that turns the z axis into a direction of any length above 0."""
    x, y, z = unit(direction)
    if z < -1.0 + 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    w = math.sqrt(0.5 * (1.0 + z))
    return (-y / (2.0 * w), x / (2.0 * w), 0.0, w)


def roll_pitch_yaw(q: Quaternion) -> Vector:
    """Return the angles of a rotation about fixed x, then y, then z, rad, as URDF writes it."""
    x, y, z, w = q
    sine = max(-1.0, min(1.0, 2.0 * (w * y - z * x)))
    if abs(sine) > 1.0 - 1e-12:  # gimbal lock: yaw and roll rotate about the same axis
        return (
            0.0,
            math.copysign(math.pi / 2.0, sine),
            -math.copysign(2.0, sine) * math.atan2(x, w),
        )
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sine),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
