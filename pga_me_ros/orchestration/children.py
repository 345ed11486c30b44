"""The child processes of a run, which the orchestrator starts, watches, restarts and stops."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pga_me_ros.dependencies import EXIT_BAD_INPUT
from pga_me_ros.errors import PgaError
from pga_me_ros.process.child import ChildProcess, python_module, stop
from pga_me_ros.process.prepared_child import PreparedChild

CRASH_LIMIT = 5
"""Deaths of one child without a completed generation in between that end the run."""

KILL_LIMIT = 20
"""The same for deaths by SIGKILL, which come from outside or from a lack of memory: only those in a row count, before
the child has done any work."""

STABLE = 60.0
"""Seconds after which a child counts as working even if it had nothing to do."""


class ChildError(PgaError):
    """A child cannot be started, or dies repeatedly."""


@contextmanager
def startable(name: str) -> Iterator[None]:
    """Turn errors of the machine in a block that starts a node's process into messages that say what to do.

    Args:
        name: Node name.

    Raises:
        ChildError: The block raised such an error.
    """
    try:
        yield
    except OSError as error:
        what = f"'{error.filename}': {error.strerror}" if error.filename else error.strerror
        raise ChildError(
            f"Node '{name}' cannot be started: {what}. Check memory, disk, and the limits on processes and open files "
            "(ulimit -u, ulimit -n), or lower evaluators."
        ) from error


@dataclass
class Child:
    """One node and its processes, the present one and earlier ones.

    Attributes:
        name: Node name.
        command: Program and arguments.
        log_path: File that its output is appended to.
        inherited: File descriptors that it keeps open.
        prepared: Process that was started early and is its first one; None for none.
        process: Its present process.
        crashes: Recent deaths by its own fault.
        kills: Recent deaths by SIGKILL.
        has_worked: Whether its present process has done some work.
    """

    name: str
    command: list[str]
    log_path: Path
    inherited: tuple[int, ...]
    prepared: PreparedChild | None = None
    crashes: int = 0
    kills: int = 0

    def __post_init__(self) -> None:
        """Start it."""
        self.start()

    def start(self) -> None:
        """Start its process, or a new one after one has ended.

        Raises:
            ChildError: The machine cannot start it.
        """
        self.has_worked, self._started = False, time.monotonic()
        early, self.prepared = self.prepared, None
        with startable(self.name):
            if early and early.begin(self.log_path, self.inherited):
                self.process: ChildProcess = early
            else:  # whatever ended an early process is reported by the one that takes its place
                self.process = ChildProcess(self.command, self.log_path, inherited=self.inherited)

    @property
    def pid(self) -> int:
        """Id of its present process."""
        return self.process.pid

    @property
    def proven(self) -> bool:
        """Whether its present process has shown that it can run."""
        return self.has_worked or time.monotonic() - self._started > STABLE


class Children:
    """All child processes of a run.

    Args:
        run_dir: Folder of the run; logs go to ``logs/``.
        ros_arguments: ROS arguments that every child gets, such as the namespace.
        lock: File descriptor of the run's lock: while a child lives, the run is in use.
        prepared: Processes that were started early, by node name; those of nodes that are started leave it.

    Attributes:
        restarts: How often a child was restarted.
        pids: Process ids of all children ever started, dead ones included.
    """

    def __init__(
        self,
        run_dir: Path,
        ros_arguments: Sequence[str],
        lock: int,
        prepared: dict[str, PreparedChild] | None = None,
    ) -> None:
        self._run_dir = run_dir
        self._prepared = {} if prepared is None else prepared
        self._lock = lock
        self._logs = run_dir / "logs"
        self._logs.mkdir(exist_ok=True)
        self._ros_arguments = list(ros_arguments)
        self._children: dict[str, Child] = {}
        self.restarts = 0
        self.pids: set[int] = set()

    def start(self, kind: str, name: str) -> Child:
        """Start a node; its parameters must be in its `parameters_file`.

        Args:
            kind: Module in `pga_me_ros.nodes`.
            name: Node name.
        """
        return self.run(name, node_command(self._run_dir, kind, name, self._ros_arguments))

    def run(self, name: str, command: list[str]) -> Child:
        """Start a command that ends when its standard input closes.

        Args:
            name: Node name.
            command: Program and arguments.
        """
        early = self._prepared.pop(name, None)
        child = Child(name, command, self._logs / f"{name}.log", (self._lock,), early)
        self._children[name] = child
        self.pids.add(child.pid)
        return child

    def pid(self, name: str) -> int | None:
        """Return the id of a child's present process, None if there is no such child (any more)."""
        child = self._children.get(name)
        return child.pid if child else None

    def names(self) -> list[str]:
        """Return the names of all children."""
        return list(self._children)

    def revive(self) -> list[str]:
        """Restart children that have died.

        Returns:
            Names of the children that were restarted.

        Raises:
            ChildError: A child died too often.
        """
        dead = [child for child in self._children.values() if not child.process.alive]
        for child in dead:
            self._count_death(child)
            child.process.close_input()
            child.start()
            self.pids.add(child.pid)
            self.restarts += 1
        return [child.name for child in dead]

    def working(self, name: str, pid: int) -> None:
        """Note that a process has done some work."""
        child = self._children.get(name)
        if child and child.pid == pid:
            child.has_worked = True

    def progressed(self) -> None:
        """Forget past deaths at the end of a generation: a child that works in between is not in a crash loop.

        The deaths of a child that dies at every start still count, even if the other nodes make progress.
        """
        for child in self._children.values():
            if child.proven:
                child.crashes = child.kills = 0

    def stop(self, names: Sequence[str] | None = None, *, at_once: bool = False) -> None:
        """Stop children with SIGTERM, then SIGKILL; return when they are gone.

        Args:
            names: Names of the children; None for all.
            at_once: Whether to send SIGKILL at once.
        """
        stopped = list(names) if names is not None else self.names()
        stop([self._children[name].process for name in stopped], at_once=at_once)
        for name in stopped:
            del self._children[name]

    def _count_death(self, child: Child) -> None:
        code = child.process.exit_code
        assert code is not None
        if code == EXIT_BAD_INPUT:
            raise ChildError(
                f"Node '{child.name}' cannot start: {child.process.last_words().rstrip('.')}. See {child.log_path}."
            )
        if code == -signal.SIGKILL:
            child.kills = 1 if child.proven else child.kills + 1
        else:  # counts even after some work: there may be one evaluation that always crashes it
            child.crashes += 1
        if child.crashes >= CRASH_LIMIT or child.kills >= KILL_LIMIT:
            deaths = child.crashes + child.kills
            words = child.process.last_words()
            raise ChildError(
                f"Node '{child.name}' crashed {deaths} times without completing a generation, the last time "
                f"{_how(code)}; "
                + (f"its last output: '{words}'. " if words else "it printed nothing. ")
                + f"See {child.log_path}."
            )


def parameters_file(run_dir: Path, kind: str) -> Path:
    """Return the YAML file with the parameters of a run's nodes of one kind."""
    return run_dir / "parameters" / f"{kind}.yaml"


def node_command(run_dir: Path, kind: str, name: str, ros_arguments: Sequence[str]) -> list[str]:
    """Return the command that starts a node of a run.

    Args:
        run_dir: Folder of the run; need not exist before the node begins.
        kind: Module in `pga_me_ros.nodes`.
        name: Node name.
        ros_arguments: Further ROS arguments.
    """
    parameters = str(parameters_file(run_dir, kind))
    arguments = ["--ros-args", "-r", f"__node:={name}", "--params-file", parameters]
    return python_module(f"pga_me_ros.nodes.{kind}", *arguments, *ros_arguments)


def _how(code: int) -> str:
    """Return how a process ended, as text."""
    if code >= 0:
        return f"with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    memory = ", perhaps because memory ran out" if name == "SIGKILL" else ""
    return f"by {name}{memory}"
