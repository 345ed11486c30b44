"""Estimates the remaining time of a matrix from what was measured so far."""

from __future__ import annotations

import math
from collections.abc import Mapping

from pga_me_ros.experiment.plan import Cell


class Estimate:
    """Cost of an evaluation by system and task: an episode of one may take a hundred times as long as another's."""

    def __init__(self) -> None:
        self._measured: dict[Cell, tuple[int, float]] = {}

    def note(self, cell: Cell, evaluations: int, seconds: float) -> None:
        """Note how much a run has done since its start."""
        self._measured[cell] = (evaluations, seconds)

    def remaining(self, left: Mapping[Cell, int], jobs: int) -> float:
        """Return the remaining seconds, NaN if unknown.

        Args:
            left: Number of remaining evaluations by cell.
            jobs: Number of runs in parallel.
        """
        total = sum(count * self._cost(cell) for cell, count in left.items() if count > 0)
        return total / max(1, min(jobs, len(left)))

    def _cost(self, cell: Cell) -> float:
        """Return the seconds per evaluation of similar runs: of the system and task, else of the task, else of any."""
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
