"""How long the rest of a matrix takes, by what was measured so far."""

from __future__ import annotations

import math
from collections.abc import Mapping

from pga_me_ros.experiment.plan import Cell


class Estimate:
    """Cost of an evaluation by system and task: an episode of one may take a hundred times that of another."""

    def __init__(self) -> None:
        self._measured: dict[Cell, tuple[int, float]] = {}

    def note(self, cell: Cell, evaluations: int, seconds: float) -> None:
        """Take what a run has done since it was started."""
        self._measured[cell] = (evaluations, seconds)

    def remaining(self, left: Mapping[Cell, int], jobs: int) -> float:
        """Return the seconds that are left, NaN while nothing is known.

        Args:
            left: Evaluations that are left, by cell.
            jobs: Runs that go on side by side.
        """
        total = sum(count * self._cost(cell) for cell, count in left.items() if count > 0)
        return total / max(1, min(jobs, len(left)))

    def _cost(self, cell: Cell) -> float:
        """Return the seconds per evaluation of runs that are alike: of the system and task, else the task, else any."""
        alike = [
            lambda other: (other.system, other.task) == (cell.system, cell.task),
            lambda other: other.task == cell.task,
            lambda other: True,
        ]
        for is_alike in alike:
            found = [m for other, m in self._measured.items() if is_alike(other) and m[0] > 0]
            if found:
                return sum(seconds for _, seconds in found) / sum(count for count, _ in found)
        return math.nan
