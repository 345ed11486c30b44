"""Rotations compared with SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pga_me_ros.player.transform import (
    Transform,
    from_z_to,
    multiply,
    roll_pitch_yaw,
    rotate,
    turn,
    unit,
)

UPRIGHT = [Rotation.from_euler("xyz", [0.4, pitch, -1.1]) for pitch in (np.pi / 2, -np.pi / 2)]
ROTATIONS = [*Rotation.random(20, np.random.default_rng(1)), *UPRIGHT]


def quaternion(rotation: Rotation) -> tuple[float, float, float, float]:
    x, y, z, w = rotation.as_quat().tolist()
    return (x, y, z, w)


@pytest.mark.parametrize("rotation", ROTATIONS)
def test_angles_give_the_same_rotation(rotation: Rotation) -> None:
    again = Rotation.from_euler("xyz", roll_pitch_yaw(quaternion(rotation)))
    assert (again * rotation.inv()).magnitude() < 1e-7


def test_products_and_rotated_vectors() -> None:
    a, b = ROTATIONS[:2]
    product = Rotation.from_quat(multiply(quaternion(a), quaternion(b)))
    assert (product * (a * b).inv()).magnitude() < 1e-12
    assert rotate(quaternion(a), (1.0, 2.0, 3.0)) == pytest.approx(a.apply([1.0, 2.0, 3.0]))


def test_a_rotation_about_an_axis() -> None:
    axis = unit((1.0, -2.0, 0.5))
    expected = Rotation.from_rotvec(0.7 * np.array(axis))
    assert turn(axis, 0.7) == pytest.approx(expected.as_quat())


@pytest.mark.parametrize(
    "to", [(0.0, 0.0, -2.0), (0.0, 0.0, 3.0), (1.0, 2.0, -0.5), (0.2, 0.0, 0.0)]
)
def test_z_is_rotated_into_a_direction(to: tuple[float, float, float]) -> None:
    assert rotate(from_z_to(to), (0.0, 0.0, 1.0)) == pytest.approx(unit(to))


def test_a_pose_and_its_inverse_cancel() -> None:
    pose = Transform((1.0, 2.0, 3.0), quaternion(ROTATIONS[3]))
    nothing = pose @ pose.inverse()
    assert nothing.position == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert nothing.rotation == pytest.approx((0.0, 0.0, 0.0, 1.0))
