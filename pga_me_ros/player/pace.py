"""Simulated time in real time, or at any multiple of it."""

from __future__ import annotations

import time
from threading import Event

LATE = 0.25
"""Seconds of delay after which we stop catching up: a robot that rushes to catch up looks wrong."""


class Pace:
    """Waits between the steps of a simulation.

    Args:
        speed: Simulated seconds per second, 0 for as fast as possible. May be changed at any time.
        stop: Ends any wait when it is set.
    """

    def __init__(self, speed: float, stop: Event) -> None:
        self.speed = speed
        self._stop = stop
        self._due = self._began = time.monotonic()

    def begin(self) -> None:
        """Start counting; the next step is due at once."""
        self._due = self._began = time.monotonic()

    def wait(self, period: float) -> None:
        """Wait until the next step is due, one step of simulated time after the last due time.

        Args:
            period: Length of the step, s.
        """
        now = time.monotonic()
        if self.speed <= 0.0:
            self._due = now
            return
        self._due += period / self.speed
        if self._due < now - LATE:
            self._due = now
        elif self._due > now:
            self._stop.wait(self._due - now)

    def elapsed(self) -> float:
        """Return the seconds since `begin`."""
        return time.monotonic() - self._began
