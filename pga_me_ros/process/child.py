"""A child process that ends with its parent, in its own session, with its output in a log file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from pga_me_ros.process.parent_watch import PARENT_WATCH

TAIL_BYTES = 10_000
"""Bytes at the end of a log that are searched for the last line."""


STOP_GRACE = 2.0
"""Seconds between asking a child to stop and killing it."""


class ChildProcess:
    """One process from start to end.

    It has its own session, so that Ctrl-C in the terminal reaches only its parent. It must end when its standard input
    closes (`process.parent_watch`), which the kernel does when the parent dies.

    Args:
        command: Program and arguments.
        log_path: File that its output is appended to.
        inherited: File descriptors that it keeps open.
        environment: Environment variables in addition to those of this process.

    Attributes:
        log_path: File that its output is appended to.

    Raises:
        OSError: The log cannot be written, or the process cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        log_path: Path,
        *,
        inherited: Sequence[int] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.log_path = log_path
        with log_path.open("ab") as log:
            self._log_start = log.tell()
            self._process = popen(command, subprocess.PIPE, log, inherited, environment)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """How it ended: exit status, or minus the number of the signal; None while it runs."""
        return self._process.poll()

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self.exit_code is None

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, unless it has ended."""
        if self.alive:
            self._process.send_signal(number)

    def kill_session(self) -> None:
        """Kill it and all processes in its group."""
        if self.alive:
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for it to end.

        Args:
            timeout: Maximum seconds to wait, None for no limit.

        Returns:
            Whether it has ended.
        """
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)
        return not self.alive

    def close_input(self) -> None:
        """Close its standard input, which tells it to end."""
        if self._process.stdin:
            self._process.stdin.close()

    def last_words(self) -> str:
        """Return the last line of its output, without the prefix of an error; empty if there is none."""
        try:
            with self.log_path.open("rb") as log:
                log.seek(max(self._log_start, log.seek(0, os.SEEK_END) - TAIL_BYTES))
                return last_line(log.read())
        except OSError:
            return ""


def last_line(output: bytes) -> str:
    """Return the last line of some output that is not empty, without the prefix of an error."""
    lines = output.decode(errors="replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    return last.removeprefix("error: ")


def popen(
    command: Sequence[str],
    stdin: int,
    output: IO[bytes],
    inherited: Sequence[int] = (),
    environment: Mapping[str, str] | None = None,
) -> subprocess.Popen[bytes]:
    """Start a process in its own session that watches its parent.

    Args:
        command: Program and arguments.
        stdin: File descriptor of its standard input, or `subprocess.PIPE`; must close when this process dies, which
            tells the child to end.
        output: File for its output and errors.
        inherited: File descriptors that it keeps open.
        environment: Environment variables in addition to those of this process.
    """
    return subprocess.Popen(
        command,
        stdin=stdin,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={**os.environ, PARENT_WATCH: "1", **(environment or {})},
        pass_fds=inherited,
    )


def stop(processes: Sequence[ChildProcess], *, at_once: bool = False) -> None:
    """Stop processes with SIGTERM, then SIGKILL; return when they are gone.

    Args:
        processes: The processes; those that have ended may be among them.
        at_once: Whether to send SIGKILL at once.
    """
    for process in processes:
        process.send(signal.SIGKILL if at_once else signal.SIGTERM)
    deadline = time.monotonic() + STOP_GRACE
    for process in processes:
        if not process.wait(max(0.0, deadline - time.monotonic())):
            process.send(signal.SIGKILL)
            process.wait()
        process.close_input()


def python_module(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module with this interpreter, importing from the same places as this process."""
    safe_path = ["-P"] if sys.flags.safe_path else []  # -P excludes the current folder
    return [sys.executable, *safe_path, "-m", module, *arguments]
