"""Which episodes of a run are in a recording, and which are missing."""

from __future__ import annotations

from collections.abc import Iterable

SHOWN = 8
"""Maximum number of ranges that are listed; further ones are counted."""


class SeenEpisodes:
    """Ids of the recorded evaluations of one run.

    Attributes:
        ids: The ids.
        repeated: Number of episodes whose id had been recorded before.
        committed: Number of evaluations in the run's archive: lower ids are of finished generations. None if unknown.
    """

    def __init__(self) -> None:
        self.ids: set[int] = set()
        self.repeated = 0
        self.committed: int | None = None

    def add(self, evaluation: int) -> None:
        """Note an episode."""
        self.repeated += evaluation in self.ids
        self.ids.add(evaluation)

    def missing(self) -> list[int]:
        """Return the missing ids between the first one recorded and the end of the last finished generation.

        Older episodes were over when the recording began; newer ones may still be in simulation. Without recorded
        metrics, the last id counts as the end.
        """
        if not self.ids:
            return []
        stop = max(self.ids) if self.committed is None else self.committed
        return [k for k in range(min(self.ids), stop) if k not in self.ids]


def ranges(ids: Iterable[int]) -> str:
    """Return ascending ids as text, such as ``3, 7-9``."""
    found: list[list[int]] = []
    for k in ids:
        if found and found[-1][1] == k - 1:
            found[-1][1] = k
        else:
            found.append([k, k])
    words = [f"{a}" if a == b else f"{a}-{b}" for a, b in found[:SHOWN]]
    more = len(found) - len(words)
    return ", ".join(words) + (f" and {more} more ranges" if more else "")
