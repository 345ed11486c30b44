"""How punctual a loop is: its period, and the time from a reading to the command that answers it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

WINDOW = 4000
"""Newest values that medians and percentiles are taken of: about a minute, in a loop that may run for days."""

LATE = 1.5
"""Interval in periods from which on a command counts as late."""


class Timing:
    """Collects moments; all times are seconds.

    Args:
        period: Time that there should be between two commands.

    Attributes:
        count: Number of commands.
        late: Number of intervals that were longer than `LATE` periods.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._intervals: deque[float] = deque(maxlen=WINDOW)
        self._latencies: deque[float] = deque(maxlen=WINDOW)
        self._last: float | None = None
        self._longest = 0.0
        self.count = 0
        self.late = 0

    def add(self, heard: float, sent: float) -> None:
        """Add a command.

        Args:
            heard: When the newest reading that it answers came.
            sent: When it was sent.
        """
        self._latencies.append(sent - heard)
        self._longest = max(self._longest, sent - heard)
        if self._last is not None:
            self._intervals.append(sent - self._last)
            self.late += sent - self._last > LATE * self._period
        self._last = sent
        self.count += 1

    def pause(self) -> None:
        """Begin anew after a pause, which is no interval."""
        self._last = None

    def values(self) -> dict[str, str]:
        """Return what was measured by name, for diagnostics."""
        jitter = np.abs(np.array(tuple(self._intervals)) - self._period)
        return {
            "commands": str(self.count),
            "latency median, 99 %, most (ms)": f"{spread(self._latencies)}, {1e3 * self._longest:.2f}",
            "jitter median, 99 % (ms)": spread(jitter),
            "late": str(self.late),
        }

    def summary(self) -> str:
        """Return what was measured in a line."""
        return f"{self.count} commands; " + "; ".join(
            f"{name} {value}" for name, value in self.values().items() if name != "commands"
        )


def spread(seconds: Iterable[float]) -> str:
    """Return median and 99th percentile of times in milliseconds, as text; ``-`` for none."""
    times = 1e3 * np.array(tuple(seconds))
    if not len(times):
        return "-, -"
    return f"{np.median(times):.2f}, {np.percentile(times, 99):.2f}"
