"""The progress of a cell of the matrix, according to its stored run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pga_me_ros.core.runs.start_from import with_controllers
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.metrics_file import METRICS_FILE
from pga_me_ros.core.storage.reevaluations import REPEATS
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.errors import StorageError
from pga_me_ros.experiment.plan import Cell
from pga_me_ros.tasks.registry import task_spec

LAST_ROW = 4096
"""Bytes at the end of metrics.csv that are enough for its last row."""


@dataclass(frozen=True)
class StoredCell:
    """Progress of a run.

    Attributes:
        evaluations: Evaluations that are committed.
        grown: Whether the budget is reached, and the elites were re-evaluated as often as the experiment asks for.
        reevaluated: Whether the best controller of every generation was re-evaluated.
    """

    evaluations: int
    grown: bool
    reevaluated: bool

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do."""
        return self.grown and self.reevaluated


def read_cell(cell: Cell, folder: Path) -> StoredCell:
    """Read the progress of a cell from its stored run.

    Args:
        cell: The cell.
        folder: Folder of its run.

    Raises:
        StorageError: The run is damaged.
    """
    file = folder / REPERTOIRE
    if not file.exists():
        return StoredCell(0, False, False)
    run = StoredRun.load(file, elites=False)
    generations, settings = len(run.generations), cell.settings
    elites = run.archive.evaluations[run.archive.filled_cells()]  # read so that damage is found now
    missing = run.reevaluations.missing(elites, cell.reevaluations)
    grown = generations >= settings.generations and not missing
    ids = np.array([best.evaluation for best in run.bests()], np.int64)
    # If a run's best controllers are unknown, there is nothing to re-evaluate.
    reevaluated = grown and not run.reevaluations.missing(ids, REPEATS)
    return StoredCell(generations * settings.batch_size, grown, reevaluated)


def require_own_run(cell: Cell, folder: Path) -> None:
    """Make sure that a folder holds the run of a cell, or none; damage is reported later, when the cell is run.

    Raises:
        StorageError: The folder holds a run with other settings.
    """
    if not (folder / REPERTOIRE).exists():
        return
    try:
        info = StoredRun.load(folder, elites=False).info
    except StorageError:
        return
    try:
        spec = task_spec(cell.task)
        settings, _ = with_controllers(folder, spec, cell.settings, new=False)
        info.require(settings, spec.to_json())
    except StorageError as error:
        raise StorageError(f"Cell {cell.name} in '{folder}': {error}") from None
    _require_same_rates(cell, folder, info.settings)


def _require_same_rates(cell: Cell, folder: Path, started_with: Mapping[str, Any]) -> None:
    """Refuse other rates: a run may change its rates on the way, but a comparison is about those of its file."""
    own, now = Settings.from_stored(started_with).rates, cell.settings.rates
    changed = [f"{name}: {own[name]} != {now[name]}" for name in own if own[name] != now[name]]
    if changed:
        raise StorageError(
            f"Cell {cell.name} in '{folder}' was started with other rates (its own != yours): {'; '.join(changed)}. "
            "Give the experiment another folder, or the rates that it was started with."
        )


def evaluations_so_far(folder: Path) -> int:
    """Return the number of evaluations that a run has committed, even while it runs; costs next to nothing."""
    try:
        with (folder / METRICS_FILE).open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - LAST_ROW))
            rows = file.read().split(b"\n")
        return int(rows[-2].split(b",")[1])
    except (
        OSError,
        IndexError,
        ValueError,
    ):  # the file does not exist yet, or has only column names
        return 0
