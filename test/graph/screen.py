"""A terminal that programs write to, and what it shows."""

from __future__ import annotations

import fcntl
import os
import re
import select
import signal
import struct
import subprocess
import termios
import threading
from collections.abc import Mapping
from pathlib import Path


class Terminal:
    """A pseudo-terminal of a given width, with a program in it, which is the leader of its session as in a login.

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
            command,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=environment,
            cwd=folder,
            start_new_session=True,
            preexec_fn=_take_terminal,
        )
        os.close(theirs)
        self._end_of_reading, self._stop_reading = os.pipe()
        self._written = b""
        self._is_open = True
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def rows(self) -> list[str]:
        """The lines on the screen, from the first."""
        return rows(self._written.decode(errors="replace"), self.columns)

    def type(self, keys: bytes) -> None:
        """Press keys; Ctrl-C is ``b"\\x03"``."""
        os.write(self._ours, keys)

    def hang_up(self) -> None:
        """Close the terminal's window: the kernel tells the program so, and its output is lost from now on."""
        os.close(self._stop_reading)
        self._let_go()

    def close(self) -> None:
        """Kill the program if it still runs; wait until nothing more is written."""
        self.process.kill()
        self.process.wait()
        if self._is_open:
            self._let_go()
            os.close(self._stop_reading)

    def _let_go(self) -> None:
        self._reader.join()
        os.close(self._ours)
        os.close(self._end_of_reading)
        self._is_open = False

    def _read(self) -> None:
        while True:
            try:
                ready, _, _ = select.select([self._ours, self._end_of_reading], [], [])
                if self._end_of_reading in ready:
                    return
                piece = os.read(self._ours, 65536)
            except OSError:
                return  # the program and all its children have ended
            self._written += piece


def _take_terminal() -> None:
    """Make the terminal on standard input that of this process, which then gets the signals of its keys."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    # A test may run in the background of a shell, where Ctrl-C is ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)


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
