"""Re-evaluating the elites of a stored run: what is left to do, and where what was done goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import CorrectedMetrics, complete_metrics
from pga_me_ros.core.storage.file_lock import FileLock, LockedError
from pga_me_ros.core.storage.metrics_file import METRICS_FILE, MetricsFile
from pga_me_ros.core.storage.reevaluations import (
    Measured,
    Reevaluations,
    RepeatOutcome,
    file_name,
)
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import StorageError


class Reevaluating:
    """Re-evaluations of a run under way; they may be cut off at any moment and continued later.

    The run's repertoire is only read. Nobody else may add re-evaluations to it until `close`.

    Args:
        run: The run.
        chosen: (P,) float32 parameters of the controllers to re-evaluate, by evaluation id.
        repeats: Wanted re-evaluations of each.
        elsewhere: What is randomized, where that is something else than in the run; None for the run's own world.

    Attributes:
        rows: All re-evaluations so far.
        missing: (evaluation id, repeat) of all that were missing at the start, in the order of `chosen`.

    Raises:
        LockedError: Another process evaluates the run's elites again.
        StorageError: The file of re-evaluations is damaged or of another run, or cannot be written.
    """

    def __init__(
        self,
        run: StoredRun,
        chosen: Mapping[int, Float32Array],
        repeats: int,
        elsewhere: str | None = None,
    ) -> None:
        self._run = run
        self._new: list[RepeatOutcome] = []
        self._lock = FileLock(run.file.with_name(f"{file_name(elsewhere)}.lock"))
        try:
            dimensions = run.spec.descriptor_dim
            self.rows = Reevaluations.load(run.file, run.info.run_id, dimensions, elsewhere)
        except BaseException:
            self.close()
            raise
        self.missing = self.rows.missing(np.array(list(chosen), np.int64), repeats)

    def take(self, outcomes: Sequence[RepeatOutcome]) -> None:
        """Take outcomes of what was missing."""
        self._new += outcomes

    def save(self) -> None:
        """Store what was taken since the last time.

        Raises:
            StorageError: The file cannot be written.
        """
        if self._new:
            self.rows = self.rows.with_more(self._new)
            self._new = []
            self.rows.save(self._run.file)

    def finish(self, *, own: bool = False) -> CorrectedMetrics | None:
        """Store what was taken, and what the run's elites are worth by it.

        Args:
            own: Whether the caller leads the run, so that it may write the run's metrics.csv though the run is in use.
                Otherwise that table is left as it is while a run grows; its next start adds the measures.

        Returns:
            Measures of the archive, None if not all of its elites were re-evaluated.

        Raises:
            StorageError: A file cannot be written.
        """
        self.save()
        run = self._run
        corrected = complete_metrics(run.archive, self.rows.statistics(run.archive))
        if corrected:
            measured = self.rows.with_measure(run.metrics[-1].generation, corrected)
            if measured.measured != self.rows.measured:
                measured.save(run.file)
            self.rows = measured
            if measured.elsewhere is None:
                _add_to_table(run, measured.measured, own=own)
        return corrected

    def close(self) -> None:
        """Let others add re-evaluations; once is enough."""
        self._lock.release()


def fittest_first(archive: Archive, best: int | None = None) -> dict[int, Float32Array]:
    """Return the parameters of elites by their evaluation ids, the fittest first.

    Args:
        archive: The archive.
        best: Only so many, None for all.
    """
    cells = archive.filled_cells()
    ordered = cells[np.argsort(-archive.fitness[cells], kind="stable")]
    return {int(archive.evaluations[c]): archive.parameters[c] for c in ordered[:best]}


def stored_measures(repertoire: Path, run_id: str, dimensions: int) -> tuple[Measured, ...]:
    """Return the measures next to a repertoire file; none where they cannot be read, which is said where they count."""
    try:
        return Reevaluations.load(repertoire, run_id, dimensions).measured
    except StorageError:
        return ()


def _add_to_table(run: StoredRun, measured: Sequence[Measured], *, own: bool) -> None:
    """Add measures to the metrics.csv of a run, if it has one that nobody else may be writing."""
    path = run.file.with_name(METRICS_FILE)
    if not path.exists():
        return
    lock = None
    if not own:
        try:
            lock = FileLock(Path(f"{run.file}.lock"))
        except LockedError:
            return
    try:
        MetricsFile(path).rebuild(run.generations, measured)
    finally:
        if lock:
            lock.release()
