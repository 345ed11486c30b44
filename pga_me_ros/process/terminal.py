"""A program's output: lines that stay, and a progress line that is overwritten in place."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from pga_me_ros.process.streams import tell

CLEAR = "\r\x1b[K"
"""Return to the start of the line and erase it."""


class Terminal:
    """Standard output of a long-running program; safe to use from several threads.

    If it is not a terminal, progress lines are not overwritten. If it cannot be written to, as on a full device or a
    terminal that is gone, work continues without it; the file given to `record` has the same lines.

    Attributes:
        in_place: Whether the progress line is overwritten, and so may change often.
    """

    def __init__(self) -> None:
        self.in_place = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
        self._status: Sequence[str] = ()
        self._lock = threading.RLock()
        self._log: TextIO | None = None

    def record(self, path: Path) -> None:
        """Also write everything shown from now on into a file, each line with its time.

        Raises:
            OSError: The file cannot be written.
        """
        self._log = path.open("a", buffering=1)

    def note(self, text: str) -> None:
        """Write a line only into the file."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        with (
            self._lock,
            contextlib.suppress(OSError),
        ):  # a full disk must not end work that can continue
            if self._log is not None:
                self._log.write(f"{now} {text}\n")

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self.note(text)
        with self.aside():
            self._tell(text)

    def show(self, parts: Sequence[str]) -> None:
        """Print the progress line, over the one before.

        Args:
            parts: Its parts, the least important last.
        """
        self.note("  ".join(parts))
        with self._lock:
            if self.in_place:
                self._status = tuple(parts)
                self._draw()
            else:
                self._tell("  ".join(parts))

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Clear the progress line while something else is written."""
        with self._lock:
            if self._status:
                self._tell(CLEAR, end="")
            yield
            if self._status:
                self._draw()

    def close(self) -> None:
        """Leave the progress line where it is; further output begins below it."""
        with self._lock:
            if self._status:
                self._tell("")
            self._status = ()

    def _draw(self) -> None:
        self._tell(CLEAR + fitted(self._status, _columns()), end="")

    def _tell(self, text: str, end: str = "\n") -> None:
        if not tell(text, end=end, reader_counts=True):
            self.in_place, self._status = False, ()
            self.note("standard output cannot be written to; what it would show stands here")


def fitted(parts: Sequence[str], columns: int) -> str:
    """Return as many parts as fit into a line, separated by two spaces; the first one is shortened if necessary.

    The last column stays free, because terminals begin a new line when it is written.
    """
    width = max(columns - 1, 1)
    count = len(parts)
    while count > 1 and len("  ".join(parts[:count])) > width:
        count -= 1
    return "  ".join(parts[:count])[:width]


def _columns() -> int:
    try:
        return os.get_terminal_size(sys.stdout.fileno()).columns or 80
    except OSError:
        return 80
