"""Logging of refusals: what of a stranger's text is shown, and how often."""

from __future__ import annotations

import time

LONGEST = 500
"""Maximum characters of a refusal that are shown; a request may hold names and lists of any length."""

BURST = 20
"""Number of refusals that are logged one by one before the log is limited to one per second."""


def printable(text: str, longest: int = LONGEST) -> str:
    """Return a text in a form that fits into one line of a log or terminal, whatever it contains."""
    cut = text if len(text) <= longest else f"{text[:longest]}... ({len(text)} characters)"
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in cut)


class CalmRefusals:
    """Decides which refusals are logged, so that a hundred errors a second do not fill the disk."""

    def __init__(self) -> None:
        self._allowance = float(BURST)
        self._looked = time.monotonic()
        self._unsaid = 0

    def line(self, reason: str) -> str | None:
        """Return what to log for a refusal, None for nothing.

        Args:
            reason: Reason of the refusal.
        """
        now = time.monotonic()
        self._allowance = min(float(BURST), self._allowance + now - self._looked)
        self._looked = now
        if self._allowance < 1.0:
            self._unsaid += 1
            return None
        self._allowance -= 1.0
        unsaid, self._unsaid = self._unsaid, 0
        return reason + (f" ({unsaid} more refusals before this one)" if unsaid else "")
