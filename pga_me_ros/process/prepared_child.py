"""A child process that is started early: it imports its libraries, then waits until it is told to begin its work."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pga_me_ros.process.child import TAIL_BYTES, ChildProcess, last_line, popen
from pga_me_ros.process.parent_watch import WAIT_FOR_WORD


class PreparedChild(ChildProcess):
    """A process that does nothing but import its libraries until `begin`; it must call `parent_watch.wait_for_word`.

    Until then, it holds nothing of the run that it may work for, which need not exist yet.

    Args:
        command: Program and arguments.

    Raises:
        OSError: The process cannot be started.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self.command = list(command)
        self._output = tempfile.TemporaryFile()  # noqa: SIM115, closed by close_input
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._process = popen(
                command, theirs.fileno(), self._output, environment={WAIT_FOR_WORD: "1"}
            )

    def begin(self, log_path: Path, inherited: Sequence[int] = ()) -> bool:
        """Tell it to begin.

        Args:
            log_path: File that its output is appended to, including what it has printed so far.
            inherited: File descriptors that it keeps open.

        Returns:
            Whether it was told; False if it has ended.

        Raises:
            OSError: The log cannot be written.
        """
        if not self.alive:
            return False
        self.log_path = log_path
        with log_path.open("ab") as log:
            self._log_start = log.tell()
            try:
                socket.send_fds(self._socket, [b"!"], [log.fileno(), *inherited])
            except (BrokenPipeError, ConnectionResetError):  # it has ended just now
                return False
        return True

    def last_words(self) -> str:
        """Return the last line of its output, wherever that went: it may have ended before it heard the word."""
        return super().last_words() or last_line(os.pread(self._output.fileno(), TAIL_BYTES, 0))

    def close_input(self) -> None:
        """Close its standard input, which tells it to end."""
        self._socket.close()
        self._output.close()
