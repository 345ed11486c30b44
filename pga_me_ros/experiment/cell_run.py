"""One cell under way: the processes that it takes, one after the other."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import yaml

from pga_me_ros.core.errors import PgaError
from pga_me_ros.core.file_lock import FileLock
from pga_me_ros.core.fitness_difference import REPEATS
from pga_me_ros.core.folders import make_folder
from pga_me_ros.experiment.plan import Cell
from pga_me_ros.experiment.stored_cell import evaluations_so_far, stored
from pga_me_ros.ros.parent_watch import PARENT_WATCH

LAST_WORDS = 10_000
"""Bytes at the end of a log in which the last line is looked for."""


class CellError(PgaError):
    """A run failed; the others may go on."""


class CellRun:
    """The run of one cell in processes of its own.

    Args:
        cell: The cell.
        experiment: Folder of the experiment.
        name: Name of the experiment, first in the namespace.
        evaluators: Evaluators of the run.
        domain: ROS domain of the run.

    Attributes:
        cell: The cell.
        folder: Folder of the run.
        log: File with what its processes print.
        begun_with: Evaluations that were there before.
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
        self._process: subprocess.Popen[bytes] | None = None
        self._step = ""
        self._started = time.monotonic()

    def start(self) -> bool:
        """Start what is to be done first.

        Returns:
            False when nothing is.

        Raises:
            PgaError: The stored run is damaged, or another process carries it out.
        """
        make_folder(self.folder.parent)
        self._lock = FileLock(self.folder.with_suffix(".lock"))
        self.begun_with = stored(self.cell, self.folder).evaluations
        return self._next()

    def poll(self) -> bool:
        """Go on with the next process when one has ended.

        Returns:
            Whether the run is still under way.

        Raises:
            CellError: A process failed.
            StorageError: The stored run is damaged.
        """
        assert self._process is not None
        code = self._process.poll()
        if code is None:
            return True
        self._close()
        if code:
            how = f"exit code {code}" if code > 0 else f"signal {-code}"
            raise CellError(f"the {self._step} ended with {how}: {self._last_words()}")
        return self._next()

    @property
    def evaluations(self) -> int:
        """Evaluations that are committed by now."""
        return evaluations_so_far(self.folder)

    @property
    def seconds(self) -> float:
        """Time since its start."""
        return time.monotonic() - self._started

    @property
    def alive(self) -> bool:
        """Whether a process of it is there."""
        return self._process is not None and self._process.poll() is None

    def stop(self) -> None:
        """Ask the process to end in good order."""
        if self._process and self.alive:
            self._process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """End the process at once; what it has started ends by itself when it notices."""
        if self._process and self.alive:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """Wait for the process's end and let others have the cell."""
        if self._process:
            self._process.wait()
            self._close()
        if self._lock:
            self._lock.release()

    def _next(self) -> bool:
        """Start the process that is to be next; returns whether there is one."""
        found = stored(self.cell, self.folder)
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
        parameters.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
        arguments = [
            "--ros-args",
            "-r",
            f"__ns:={self._namespace}",
            "--params-file",
            str(parameters),
        ]
        return ["pga_me_ros.nodes.orchestrator", *arguments]

    def _reevaluation(self) -> list[str]:
        arguments = [str(self.folder), "--bests", "--repeats", str(REPEATS)]
        return [
            "pga_me_ros.experiment.reevaluation",
            *arguments,
            "--processes",
            str(self._evaluators),
        ]

    def _run(self, module_and_arguments: list[str]) -> None:
        """Start a module in a session of its own, so that Ctrl-C in the terminal reaches the experiment alone."""
        safe_path = ["-P"] if sys.flags.safe_path else []
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, *safe_path, "-m", *module_and_arguments],
                stdin=subprocess.PIPE,  # closes when we die: the child's sign to end
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, PARENT_WATCH: "1", "ROS_DOMAIN_ID": str(self._domain)},
            )

    def _close(self) -> None:
        assert self._process is not None
        if self._process.stdin:
            self._process.stdin.close()

    def _last_words(self) -> str:
        with self.log.open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - LAST_WORDS))
            lines = log.read().decode(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
        return last.removeprefix("error: ")
