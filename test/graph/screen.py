"""A terminal that programs write to, and what it shows."""

from __future__ import annotations

import fcntl
import os
import re
import struct
import subprocess
import termios
import threading
from collections.abc import Mapping
from pathlib import Path


class Terminal:
    """A pseudo-terminal of a given width, with a program in it.

    Args:
        command: The program and its arguments.
        columns: Width in characters.
        environment: Environment of the program.
        folder: Working directory of the program.
    """

    def __init__(
        self, command: list[str], columns: int, environment: Mapping[str, str], folder: Path
    ) -> None:
        self.columns = columns
        self._ours, theirs = os.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment, cwd=folder
        )
        os.close(theirs)
        self._written = b""
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def rows(self) -> list[str]:
        """The lines on the screen, from the first."""
        return rows(self._written.decode(errors="replace"), self.columns)

    def close(self) -> None:
        """Wait for the program to end, after which nothing more is written."""
        self.process.kill()
        self.process.wait()
        self._reader.join()
        os.close(self._ours)

    def _read(self) -> None:
        while True:
            try:
                piece = os.read(self._ours, 65536)
            except OSError:
                return  # the program and all its children have ended
            self._written += piece


def rows(text: str, columns: int) -> list[str]:
    """Return the rows that a terminal shows for a text with returns, line feeds and erasures."""
    screen, row, column = [""], 0, 0
    for piece in re.findall(r"\x1b\[[0-9;]*[A-Za-z]|.", text, re.DOTALL):
        if piece == "\r":
            column = 0
        elif piece == "\n":
            row += 1
            screen.append("")
        elif piece == "\x1b[K":
            screen[row] = screen[row][:column]
        elif piece.startswith("\x1b"):
            continue  # a color
        else:
            if column == columns:
                row, column = row + 1, 0
                screen.append("")
            screen[row] = screen[row].ljust(column)[:column] + piece + screen[row][column + 1 :]
            column += 1
    return screen
