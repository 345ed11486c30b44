"""Where a robot is relative to its target: progress, angle to it, velocity in the robot's frame.

The numbers equal those of PyBullet's own locomotion environments bit for bit. That is why sums are
taken in NumPy's order, the angle by NumPy's arctan2 (whose vectorized form differs from the C
library's in the last bit; sine and cosine do not) and products by NumPy's dot (which may fuse
multiply and add).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pga_me_ros.tasks.bullet.robots import CONTROL_PERIOD
from pga_me_ros.tasks.bullet.sums import pairwise_sum

TARGET_X = 1000.0
"""x of the target, m; its y is 0. Far enough away that progress is speed along x."""

Vector = tuple[float, float, float]


class Heading:
    """Computes a robot's heading; keeps small arrays, which are expensive to create but cheap to fill."""

    def __init__(self) -> None:
        """Make the arrays."""
        self._offset = np.zeros(2)
        self._rotation = np.diag((0.0, 0.0, 1.0))
        self._entries = self._rotation.reshape(-1)
        self._velocity = np.zeros(3)

    def __call__(
        self, xs: Sequence[float], ys: Sequence[float], yaw: float, velocity: Vector
    ) -> tuple[float, list[float]]:
        """Return the potential, whose change is the progress, and five entries of the observation.

        Args:
            xs: x of each part of the robot, m. The floor counts as one more part, at the origin.
            ys: y of each part, m.
            yaw: Yaw of the torso, rad.
            velocity: Velocity of the torso, m/s.

        Returns:
            Minus the distance to the target divided by the control period, m/s; and a list of sine and
            cosine of the angle to the target and the velocity rotated by -yaw, m/s.
        """
        count = len(xs) + 1
        ahead = TARGET_X - pairwise_sum(xs) / count
        if yaw == 0.0 and ahead > 0.0 and not any(ys):
            # A planar robot on its line: a shortcut that gives exactly what the code below would.
            turned = [velocity[0] + 0.0, velocity[1] + 0.0, velocity[2] + 0.0]
            return -ahead / CONTROL_PERIOD, [0.0, 1.0, *turned]
        aside = 0.0 - pairwise_sum(ys) / count
        offset, entries, speed = self._offset, self._entries, self._velocity
        offset[0], offset[1] = aside, ahead
        potential = -math.sqrt(offset.dot(offset)) / CONTROL_PERIOD
        angle = float(np.arctan2(aside, ahead)) - yaw
        entries[0] = entries[4] = math.cos(-yaw)
        entries[3] = sine = math.sin(-yaw)
        entries[1] = -sine
        speed[0], speed[1], speed[2] = velocity
        return potential, [math.sin(angle), math.cos(angle), *self._rotation.dot(speed).tolist()]
