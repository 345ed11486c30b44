"""The child processes of a run: started, watched, restarted and stopped by the orchestrator."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from pga_me_ros.core.errors import PgaError
from pga_me_ros.ros.parent_watch import PARENT_WATCH
from pga_me_ros.ros.process import EXIT_BAD_INPUT

STOP_GRACE = 2.0
"""Seconds between asking a child to stop and killing it."""

CRASH_LIMIT = 5
"""Deaths of one child, with no good end of a generation in between, that end the run."""

KILL_LIMIT = 20
"""The same for deaths by SIGKILL, which come from outside or from a machine short of memory: those in a row before the
child has done any work."""

LAST_WORDS = 10_000
"""Bytes at the end of a log in which the last line is looked for."""

STABLE = 60.0
"""Seconds after which a child that had nothing to do counts as one that works."""


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
        crashes: Deaths by its own fault that are not forgotten.
        kills: Deaths by SIGKILL that are not forgotten.
        works: Whether its present process has done some work.
    """

    name: str
    arguments: list[str]
    log_path: Path
    inherited: tuple[int, ...]
    process: subprocess.Popen[bytes] | None = None
    crashes: int = 0
    kills: int = 0
    works: bool = False
    _started: float = 0.0
    _log_start: int = 0

    @property
    def pid(self) -> int:
        """Process id, 0 before the first start."""
        return self.process.pid if self.process else 0

    def start(self) -> None:
        """Start the process in a session of its own, so that Ctrl-C in the terminal reaches the orchestrator alone."""
        self.works, self._started = False, time.monotonic()
        log: IO[bytes]
        with self.log_path.open("ab") as log:
            self._log_start = log.tell()
            self.process = subprocess.Popen(
                self.arguments,
                stdin=subprocess.PIPE,  # closes when we die: the child's sign to end
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, PARENT_WATCH: "1"},
                pass_fds=self.inherited,
            )

    @property
    def proven(self) -> bool:
        """Whether its present process has shown that it can live."""
        return self.works or time.monotonic() - self._started > STABLE

    def last_words(self) -> str:
        """Return the last line that its present process wrote to the log, without what marks it as an error."""
        try:
            with self.log_path.open("rb") as log:
                log.seek(max(self._log_start, log.seek(0, os.SEEK_END) - LAST_WORDS))
                lines = log.read().decode(errors="replace").split("\n")
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
        return self.run(name, arguments + self._ros_arguments)

    def run(self, name: str, command: list[str]) -> Child:
        """Start a command that ends when its standard input closes.

        Args:
            name: Node name.
            command: Program and arguments.
        """
        child = Child(name, command, self._logs / f"{name}.log", (self._lock,))
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

    def working(self, name: str, pid: int) -> None:
        """Take note that a process has done some work."""
        child = self._children.get(name)
        if child and child.pid == pid:
            child.works = True

    def progressed(self) -> None:
        """Forget past deaths at the end of a generation: what has part in the work between them is in no crash loop.

        A child that dies at every start is remembered even while the others get on with the run.
        """
        for child in self._children.values():
            if child.proven:
                child.crashes = child.kills = 0

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
        if code == -signal.SIGKILL:
            child.kills = 1 if child.proven else child.kills + 1
        else:  # work before it is no excuse: there may be one evaluation that it never survives
            child.crashes += 1
        if child.crashes >= CRASH_LIMIT or child.kills >= KILL_LIMIT:
            deaths = child.crashes + child.kills
            words = child.last_words()
            raise ChildError(
                f"Node '{child.name}' died {deaths} times without getting on, the last time {_how(code)}; "
                + (f"its last words: '{words}'. " if words else "it said nothing. ")
                + f"See {child.log_path}."
            )


def _how(code: int) -> str:
    """Return in words how a process ended."""
    if code >= 0:
        return f"with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    memory = ", perhaps because memory ran out" if name == "SIGKILL" else ""
    return f"by {name}{memory}"


def _send(child: Child, what: signal.Signals) -> None:
    assert child.process is not None
    if child.process.poll() is None:
        child.process.send_signal(what)


def _close_input(child: Child) -> None:
    if child.process and child.process.stdin:
        child.process.stdin.close()
