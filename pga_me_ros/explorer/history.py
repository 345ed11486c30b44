"""The history of a run as its graph tells it: curves, and what each operator contributed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pga_me_ros.client import ListedGeneration
from pga_me_ros.explorer.description import CURVES, contributions, plain


class History:
    """Generations of a run, taken in as they come."""

    def __init__(self) -> None:
        self._generations: dict[int, ListedGeneration] = {}

    @property
    def first_wanted(self) -> int:
        """Number of the first generation to ask for: the last known one, which may have been re-evaluated since."""
        return max(self._generations, default=0)

    def extend(self, generations: Iterable[ListedGeneration]) -> None:
        """Take in generations; what was known about them before is replaced."""
        self._generations.update({g.generation: g for g in generations})

    def described(self) -> dict[str, Any]:
        """Return curves, contributions and corrected measures as `description.describe` does."""
        rows = [self._generations[number] for number in sorted(self._generations)]
        measured = [
            {"generation": row.generation, **row.corrected} for row in rows if row.corrected
        ]
        last = dict(rows[-1].corrected) if rows else {}
        return {
            "curves": {name: plain([getattr(row, name) for row in rows]) for name in CURVES},
            "contributions": contributions(
                lambda name, operator: sum(getattr(r, name).get(operator.label, 0) for r in rows)
            ),
            "measured": plain(measured),
            "corrected": plain({"elites": rows[-1].coverage, **last}) if last else None,
        }
