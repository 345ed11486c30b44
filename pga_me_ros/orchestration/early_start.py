"""What a run's start can do while the orchestrator still listens for namesakes."""

from __future__ import annotations

import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.runs.run_directory import stored_generations
from pga_me_ros.core.settings import Settings
from pga_me_ros.orchestration.calls import Waiter
from pga_me_ros.orchestration.children import node_command, startable
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.free_name import stop_if_asked
from pga_me_ros.orchestration.team import SINGLETONS, evaluator_names, ros_arguments
from pga_me_ros.process.child import stop
from pga_me_ros.process.prepared_child import PreparedChild
from pga_me_ros.tasks.spec import TaskSpec


class EarlyStart:
    """Has the processes of a run's nodes import their libraries, and makes the cells of its archive: both take seconds.

    Nothing of it can be seen in the graph or in the run's folder before the name is known to be free: the processes
    wait for the orchestrator's word before they become nodes, and the cells are only kept in memory. Processes that are
    left at the end of the block are killed.

    Args:
        control: The orchestrator's node.
        path: Folder of the run.
        spec: Task.

    Attributes:
        processes: The processes by node name; whoever tells one to begin takes it out.
    """

    def __init__(self, control: Control, path: Path, spec: TaskSpec) -> None:
        self._control = control
        self._path = path
        self._cells = threading.Thread(
            target=_make_cells, args=(spec, control.settings), name="cells", daemon=True
        )
        self.processes: dict[str, PreparedChild] = {}

    def __enter__(self) -> EarlyStart:
        """Start what the run will need."""
        generations = stored_generations(self._path)
        if not generations:
            self._cells.start()
        if generations < self._control.settings.generations:
            self._start_processes()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Kill the processes that nobody has told to begin; they have done nothing yet."""
        stop(list(self.processes.values()), at_once=True)

    def finish(self) -> None:
        """Wait until the cells are made.

        Raises:
            StoppedError: The user stopped the run.
        """
        Waiter(lambda: stop_if_asked(self._control)).until(lambda: not self._cells.is_alive())

    @property
    def words(self) -> str:
        """What starts, in words; empty for nothing."""
        if not self.processes:
            return ""
        count = len(self.processes) - len(SINGLETONS)
        evaluators = f"{count} evaluator{'s' * (count > 1)}"
        wait = self._control.options.discovery_wait
        listening = f"; listening for others of this name for {wait:g} s" if wait else ""
        return f"starting {', '.join(SINGLETONS)} and {evaluators}{listening}"

    def _start_processes(self) -> None:
        members = {name: name for name in SINGLETONS}
        members |= dict.fromkeys(evaluator_names(self._control.options), "evaluator")
        arguments = ros_arguments(self._control)
        for name, kind in members.items():
            command = node_command(self._path, kind, name, arguments)
            with startable(name):
                self.processes[name] = PreparedChild(command)


def _make_cells(spec: TaskSpec, settings: Settings) -> None:
    """Make the archive's cells, which are then remembered; `open_run` will report what is wrong with the settings."""
    with suppress(Exception):
        make_archive(spec, settings)
