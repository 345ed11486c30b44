"""From an action to the torques of a robot's motors."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.protocol import NonFiniteActionError


class Motors:
    """The motors of a robot.

    Args:
        name: Name of the task, for messages.
        greatest: Greatest torque of each motor, at an action of 1, N·m.
    """

    def __init__(self, name: str, greatest: Sequence[float]) -> None:
        """Keep the name and the torques."""
        self._name = name
        self._greatest = tuple(greatest)

    def __call__(self, commands: list[float]) -> list[float]:
        """Return the torques, N·m, for an action; entries are clipped to ±1.

        Args:
            commands: One number per motor.

        Raises:
            TaskError: The number of entries is wrong.
            NonFiniteActionError: An entry is NaN or infinite.
        """
        if len(commands) != len(self._greatest):
            raise TaskError(
                f"{self._name} got an action of {len(commands)} entries; expected {len(self._greatest)}"
            )
        return [
            scale * (value if -1.0 <= value <= 1.0 else self._limit(value))
            for scale, value in zip(self._greatest, commands, strict=True)
        ]

    def _limit(self, value: float) -> float:
        if not math.isfinite(value):
            raise NonFiniteActionError(
                f"{self._name} got an action with {value}; expected finite numbers: check the "
                "controller's parameters for NaN and infinity"
            )
        return math.copysign(1.0, value)
