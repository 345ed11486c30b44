"""Which episodes of a run are in a recording, and which are not."""

from __future__ import annotations

from collections.abc import Iterable

SHOWN = 8
"""Ranges of ids that are named; more are counted."""


class SeenEpisodes:
    """Ids of the recorded evaluations of one run.

    Attributes:
        ids: The ids.
        repeated: Episodes that came although their id was there.
        committed: Evaluations that the run's archive has: ids below are of finished generations. None while unknown.
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
        """Return the ids between the first that is here and the end of the last finished generation that are not.

        What is older than the first was over when the recording began; what is newer may still be simulated. Where no
        metrics were recorded, nothing tells how far the run had come, and the last id counts as the end.
        """
        if not self.ids:
            return []
        stop = max(self.ids) if self.committed is None else self.committed
        return [k for k in range(min(self.ids), stop) if k not in self.ids]


def ranges(ids: Iterable[int]) -> str:
    """Return ascending ids in words, such as ``3, 7-9``."""
    found: list[list[int]] = []
    for k in ids:
        if found and found[-1][1] == k - 1:
            found[-1][1] = k
        else:
            found.append([k, k])
    words = [f"{a}" if a == b else f"{a}-{b}" for a, b in found[:SHOWN]]
    more = len(found) - len(words)
    return ", ".join(words) + (f" and {more} ranges more" if more else "")
