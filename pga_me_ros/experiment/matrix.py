"""Runs the cells of a matrix in parallel, with progress, failures, and a clean end."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pga_me_ros.errors import PgaError
from pga_me_ros.experiment.cell_run import CellRun
from pga_me_ros.experiment.estimate import Estimate
from pga_me_ros.experiment.plan import Cell
from pga_me_ros.process.signals import Signals
from pga_me_ros.process.terminal import Terminal

POLL = 0.2
"""Seconds between two checks on the processes."""

PRINT_PERIOD = 60.0
"""Seconds between two progress lines if they are not overwritten, as in a log file."""

PARTICIPANTS = 30
"""Processes per machine that reliably find each other in one ROS domain: Fast DDS searches for the first 32."""

SINGLE_NODES = 4
"""Number of processes of a run besides its evaluators."""


@dataclass(frozen=True)
class Failure:
    """A run that could not be carried out.

    Attributes:
        cell: Its cell.
        reason: Why it failed.
        log: File with more information.
    """

    cell: Cell
    reason: str
    log: Path

    def __str__(self) -> str:
        """Return the failure as one line."""
        return f"{self.cell.name}: {self.reason.rstrip('.')}. See {self.log}."


class Matrix:
    """Carries out cells.

    Args:
        cells: The cells to carry out.
        folder: Folder of the experiment.
        jobs: Maximum number of runs in parallel.
        cores: Number of cores that they share.
        domain: ROS domain of the first ones.
        terminal: Where progress is shown.

    Attributes:
        failures: Runs that failed.
    """

    def __init__(
        self,
        cells: Sequence[Cell],
        folder: Path,
        *,
        jobs: int,
        cores: int,
        domain: int,
        terminal: Terminal,
    ) -> None:
        self._budget = {
            cell: cell.settings.generations * cell.settings.batch_size for cell in cells
        }
        self._folder = folder
        self._todo = list(cells)
        self._running: dict[int, CellRun] = {}
        self._done: dict[Cell, int] = dict.fromkeys(cells, 0)
        self._finished = 0
        self._jobs = min(jobs, len(cells))
        self._evaluators = max(1, cores // max(1, self._jobs))
        self._domain = domain
        self._terminal = terminal
        self._estimate = Estimate()
        self._shown = -math.inf
        self.failures: list[Failure] = []

    def run(self, signals: Signals) -> None:
        """Carry out all cells, or stop at a signal; no process is left on return."""
        try:
            while (self._todo or self._running) and not signals.received:
                self._start()
                self._look()
                self._show()
                if self._running:
                    signals.wait(POLL)
        finally:
            self._end(signals)

    @property
    def further_domains(self) -> int:
        """Number of ROS domains that it uses beyond the first."""
        return self._further(self._jobs - 1)

    def _further(self, slot: int) -> int:
        """Return how far the domain of a place is beyond the first."""
        return max(0, slot) // max(1, PARTICIPANTS // (SINGLE_NODES + self._evaluators))

    @property
    def finished(self) -> int:
        """Number of finished cells."""
        return self._finished

    def _start(self) -> None:
        """Start runs in free places."""
        for slot in range(self._jobs):
            while slot not in self._running and self._todo:
                cell = self._todo.pop(0)
                domain = self._domain + self._further(slot)
                run = CellRun(cell, self._folder, self._folder.name, self._evaluators, domain)
                try:
                    going = run.start()
                except (PgaError, OSError) as error:
                    self._failed(run, error)
                    continue
                self._done[cell] = run.begun_with
                if going:
                    self._running[slot] = run
                else:
                    self._ended(run)

    def _look(self) -> None:
        """Check on the running cells."""
        for slot, run in list(self._running.items()):
            try:
                going = run.poll()
            except (PgaError, OSError) as error:
                del self._running[slot]
                self._failed(run, error)
                continue
            if not going:
                del self._running[slot]
                self._ended(run)

    def _ended(self, run: CellRun) -> None:
        run.close()
        self._finished += 1
        self._done[run.cell] = self._budget[run.cell]
        self._terminal.say(f"finished {run.cell.name}")

    def _failed(self, run: CellRun, error: Exception) -> None:
        run.close()
        self.failures.append(Failure(run.cell, str(error), run.log))
        self._terminal.say(f"failed {self.failures[-1]}")

    def _show(self) -> None:
        """Show progress: once a second if the line is overwritten, else once a minute."""
        now = time.monotonic()
        if (
            now < self._shown + (1.0 if self._terminal.in_place else PRINT_PERIOD)
            or not self._running
        ):
            return
        self._shown = now
        for run in self._running.values():
            self._done[run.cell] = max(run.evaluations, self._done[run.cell])
            self._estimate.note(run.cell, self._done[run.cell] - run.begun_with, run.seconds)
        self._terminal.show(self.progress())

    def progress(self) -> list[str]:
        """Return the parts of the progress line, the least important last."""
        failed = {failure.cell for failure in self.failures}
        left = {
            cell: budget - self._done[cell]
            for cell, budget in self._budget.items()
            if cell not in failed and budget > self._done[cell]
        }
        seconds = self._estimate.remaining(left, self._jobs)
        parts = [
            f"runs {self._finished}/{len(self._budget)}",
            f"ETA {duration(seconds)}",
            f"evaluations {sum(self._done.values()):,}/{sum(self._budget.values()):,}",
        ]
        if failed:
            parts.insert(1, f"failed {len(failed)}")
        return [*parts, f"running {', '.join(run.cell.name for run in self._running.values())}"]

    def _end(self, signals: Signals) -> None:
        """Stop all runs; kill them at a second signal."""
        self._terminal.close()
        for run in self._running.values():
            run.stop()
        while any(run.alive for run in self._running.values()):
            if signals.impatient:
                for run in self._running.values():
                    run.kill()
            signals.wait(POLL)
        for run in self._running.values():
            run.close()
        self._running.clear()


def duration(seconds: float) -> str:
    """Return hours and minutes as text of constant width."""
    if math.isnan(seconds):
        return "?"
    minutes = math.ceil(seconds / 60)
    return f"{minutes // 60}:{minutes % 60:02d} h"
