"""The child processes of a run: started, watched, restarted and stopped by the orchestrator."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from pga_me_ros.core.errors import PgaError
from pga_me_ros.ros.process import EXIT_BAD_INPUT, PARENT_WATCH

STOP_GRACE = 2.0
"""Seconds between asking a child to stop and killing it."""

CRASH_WINDOW = 60.0
"""Seconds over which deaths of one child count as a crash loop."""

CRASH_LIMIT = 5
"""Deaths within the window, and within one generation, that end the run."""

KILL_LIMIT = 20
"""The same where the last death was a SIGKILL: that comes from outside, or from a machine short of memory."""


class ChildError(PgaError):
    """A child cannot be started, or dies again and again."""


@dataclass
class Child:
    """One node in a process of its own.

    Attributes:
        name: Node name.
        arguments: Command line.
        log_path: File that its output is appended to.
        inherited: File descriptors that it keeps open.
    """

    name: str
    arguments: list[str]
    log_path: Path
    inherited: tuple[int, ...]
    process: subprocess.Popen[bytes] | None = None
    deaths: list[float] = field(default_factory=list)

    @property
    def pid(self) -> int:
        """Process id, 0 before the first start."""
        return self.process.pid if self.process else 0

    def start(self) -> None:
        """Start the process in a session of its own, so that Ctrl-C in the terminal reaches the orchestrator alone."""
        log: IO[bytes]
        with self.log_path.open("ab") as log:
            self.process = subprocess.Popen(
                self.arguments,
                stdin=subprocess.PIPE,  # closes when we die: the child's sign to end
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, PARENT_WATCH: "1"},
                pass_fds=self.inherited,
            )

    def last_words(self) -> str:
        """Return the last line that it wrote to its log, without what marks it as an error."""
        try:
            lines = self.log_path.read_text(errors="replace").split("\n")
        except OSError:
            return ""
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return last.removeprefix("error: ")


class Children:
    """All child processes of a run.

    Args:
        run_dir: Folder of the run; logs go to ``logs/``.
        ros_arguments: ROS arguments that every child gets, such as the namespace.
        lock: File descriptor of the run's lock: while a child lives, the run is in use.

    Attributes:
        restarts: How often a child was started again.
        pids: Process ids of all children ever started, the dead ones too.
    """

    def __init__(self, run_dir: Path, ros_arguments: Sequence[str], lock: int) -> None:
        self._lock = lock
        self._logs = run_dir / "logs"
        self._logs.mkdir(exist_ok=True)
        self._ros_arguments = list(ros_arguments)
        self._children: dict[str, Child] = {}
        self.restarts = 0
        self.pids: set[int] = set()

    def start(self, kind: str, name: str, parameters: Path) -> Child:
        """Start a node.

        Args:
            kind: Module in `pga_me_ros.nodes`.
            name: Node name.
            parameters: YAML file with its parameters.
        """
        # All nodes of a run import from the same places: -P leaves the current folder out.
        safe_path = ["-P"] if sys.flags.safe_path else []
        arguments = [sys.executable, *safe_path, "-m", f"pga_me_ros.nodes.{kind}", "--ros-args"]
        arguments += ["-r", f"__node:={name}", "--params-file", str(parameters)]
        log_path = self._logs / f"{name}.log"
        child = Child(name, arguments + self._ros_arguments, log_path, (self._lock,))
        self._children[name] = child
        self._start(child)
        return child

    def pid(self, name: str) -> int:
        """Return the process id of a child's present incarnation."""
        return self._children[name].pid

    def names(self) -> list[str]:
        """Return the names of all children."""
        return list(self._children)

    def revive(self) -> list[str]:
        """Start again what has died.

        Returns:
            Names of the children that were started again.

        Raises:
            ChildError: One has died too often.
        """
        dead = [c for c in self._children.values() if c.process and c.process.poll() is not None]
        for child in dead:
            self._count_death(child)
            _close_input(child)
            self._start(child)
            self.restarts += 1
        return [child.name for child in dead]

    def progressed(self) -> None:
        """Forget past deaths: what gets on with the work between them is no crash loop."""
        for child in self._children.values():
            child.deaths.clear()

    def stop(self, names: Sequence[str] | None = None, *, at_once: bool = False) -> None:
        """Stop children, politely first; returns when they are gone.

        Args:
            names: Which; None for all.
            at_once: Whether to be impolite.
        """
        stopped = [self._children[n] for n in (names if names is not None else self.names())]
        for child in stopped:
            _send(child, signal.SIGKILL if at_once else signal.SIGTERM)
        deadline = time.monotonic() + STOP_GRACE
        for child in stopped:
            assert child.process is not None
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                _send(child, signal.SIGKILL)
                child.process.wait()
            _close_input(child)
            del self._children[child.name]

    def _start(self, child: Child) -> None:
        child.start()
        self.pids.add(child.pid)

    def _count_death(self, child: Child) -> None:
        assert child.process is not None
        code = child.process.returncode
        if code == EXIT_BAD_INPUT:
            raise ChildError(
                f"Node '{child.name}' cannot start: {child.last_words().rstrip('.')}. See {child.log_path}."
            )
        now = time.monotonic()
        child.deaths = [t for t in child.deaths if now - t < CRASH_WINDOW] + [now]
        limit = KILL_LIMIT if code == -signal.SIGKILL else CRASH_LIMIT
        if len(child.deaths) >= limit:
            raise ChildError(
                f"Node '{child.name}' died {limit} times within {CRASH_WINDOW:.0f} s (last exit "
                f"code {code}): {child.last_words()} See {child.log_path}. "
                "What was committed is kept; start again to resume."
            )


def _send(child: Child, what: signal.Signals) -> None:
    assert child.process is not None
    if child.process.poll() is None:
        child.process.send_signal(what)


def _close_input(child: Child) -> None:
    if child.process and child.process.stdin:
        child.process.stdin.close()
