"""A cell being run: its processes, one after the other."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import yaml

from pga_me_ros.core.storage.file_lock import FileLock
from pga_me_ros.core.storage.files import make_folder
from pga_me_ros.core.storage.reevaluations import REPEATS
from pga_me_ros.errors import PgaError
from pga_me_ros.experiment.plan import Cell
from pga_me_ros.experiment.stored_cell import evaluations_so_far, read_cell
from pga_me_ros.process.child import ChildProcess, python_module


class CellError(PgaError):
    """A run failed; the others may continue."""


class CellRun:
    """The run of one cell in its own processes.

    Args:
        cell: The cell.
        experiment: Folder of the experiment.
        name: Name of the experiment, first in the namespace.
        evaluators: Number of evaluators of the run.
        domain: ROS domain of the run.

    Attributes:
        cell: The cell.
        folder: Folder of the run.
        log: File with the output of its processes.
        begun_with: Number of evaluations committed before.
    """

    def __init__(
        self, cell: Cell, experiment: Path, name: str, evaluators: int, domain: int
    ) -> None:
        self.cell = cell
        self.folder = cell.folder(experiment)
        self.log = self.folder.with_suffix(".log")
        self.begun_with = 0
        self._namespace = cell.namespace(name)
        self._evaluators = evaluators
        self._domain = domain
        self._lock: FileLock | None = None
        self._process: ChildProcess | None = None
        self._step = ""
        self._started = time.monotonic()

    def start(self) -> bool:
        """Start the first process.

        Returns:
            False if nothing is left to do.

        Raises:
            PgaError: The stored run is damaged, or another process is running it.
        """
        make_folder(self.folder.parent)
        self._lock = FileLock(self.folder.with_suffix(".lock"))
        self.begun_with = read_cell(self.cell, self.folder).evaluations
        return self._next()

    def poll(self) -> bool:
        """Start the next process when one has ended.

        Returns:
            Whether the run is still in progress.

        Raises:
            CellError: A process failed.
            StorageError: The stored run is damaged.
        """
        assert self._process is not None
        code = self._process.exit_code
        if code is None:
            return True
        self._process.close_input()
        if code:
            how = f"exit code {code}" if code > 0 else f"signal {-code}"
            raise CellError(f"the {self._step} ended with {how}: {self._last_words()}")
        return self._next()

    @property
    def evaluations(self) -> int:
        """Number of evaluations committed so far."""
        return evaluations_so_far(self.folder)

    @property
    def seconds(self) -> float:
        """Time since its start."""
        return time.monotonic() - self._started

    @property
    def alive(self) -> bool:
        """Whether one of its processes is running."""
        return self._process is not None and self._process.alive

    def stop(self) -> None:
        """Ask the process to stop."""
        if self._process:
            self._process.send(signal.SIGINT)

    def kill(self) -> None:
        """Kill the process; its children end by themselves when they notice."""
        if self._process:
            self._process.kill_session()

    def close(self) -> None:
        """Wait for the process to end and release the cell."""
        if self._process:
            self._process.wait()
            self._process.close_input()
        if self._lock:
            self._lock.release()

    def _next(self) -> bool:
        """Start the next process; return whether there is one."""
        found = read_cell(self.cell, self.folder)
        if found.finished:
            return False
        step, command = (
            ("reevaluation", self._reevaluation)
            if found.grown
            else ("orchestrator", self._orchestrator)
        )
        if step == self._step:
            raise CellError(f"the {step} ended, but left its work undone: {self._last_words()}")
        self._step = step
        self._run(command())
        return True

    def _orchestrator(self) -> list[str]:
        parameters = self.folder.with_suffix(".yaml")
        values = {k: list(v) if isinstance(v, tuple) else v for k, v in self.cell.given.items()}
        values |= {"run_dir": str(self.folder), "evaluators": self._evaluators, "serve": False}
        values["reevaluations"] = self.cell.reevaluations
        parameters.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
        arguments = ["-r", f"__ns:={self._namespace}", "--params-file", str(parameters)]
        return python_module("pga_me_ros.nodes.orchestrator", "--ros-args", *arguments)

    def _reevaluation(self) -> list[str]:
        arguments = ["--bests", "--repeats", str(REPEATS), "--processes", str(self._evaluators)]
        return python_module("pga_me_ros.experiment.reevaluation", str(self.folder), *arguments)

    def _run(self, command: list[str]) -> None:
        self._process = ChildProcess(
            command, self.log, environment={"ROS_DOMAIN_ID": str(self._domain)}
        )

    def _last_words(self) -> str:
        words = self._process.last_words() if self._process else ""
        return words or "it printed nothing"
