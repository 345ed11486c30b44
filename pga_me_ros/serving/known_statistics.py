"""Statistics from re-evaluations, for the archive manager; reloaded when their file or the archive changes."""

from __future__ import annotations

from pathlib import Path

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import CorrectedMetrics, complete_metrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.storage.reevaluations import FILE, Reevaluations
from pga_me_ros.errors import StorageError


class KnownStatistics:
    """Statistics of the elites that are served.

    Args:
        repertoire: The repertoire file; re-evaluations are next to it, if there are any.
        run_id: Id of its run.
        dimensions: Its number of descriptor dimensions.
    """

    def __init__(self, repertoire: Path, run_id: str, dimensions: int) -> None:
        self._repertoire = repertoire
        self._file = repertoire.with_name(FILE)
        self._run_id = run_id
        self._dimensions = dimensions
        self._signature: tuple[int, int, int] | None = None
        self._read: Reevaluations | StorageError = Reevaluations.none(run_id, dimensions)
        self._state: tuple[object, ...] = ()
        self._statistics: Statistics | None = None

    def of(self, archive: Archive, generation: int) -> Statistics:
        """Return the statistics of an archive's elites.

        Args:
            archive: The archive as it is now.
            generation: Its last generation; a new one means that the archive has changed.

        Raises:
            StorageError: The file of re-evaluations is damaged, belongs to another run or cannot be read.
        """
        rows = self._rows()
        state = (self._signature, generation, id(archive))
        if self._statistics is None or state != self._state:
            self._statistics, self._state = rows.statistics(archive), state
        return self._statistics

    def measures(
        self, archive: Archive, generation: int, *, growing: bool
    ) -> CorrectedMetrics | None:
        """Return the corrected metrics, from re-evaluations of all elites, None while they are unknown.

        Args:
            archive: The archive as it is now.
            generation: Its last generation.
            growing: Whether a run adds to it. If so, only stored metrics count: the archive may have changed since the
                re-evaluations.
        """
        try:
            stored = {m.generation: m.corrected for m in self._rows().measured}
            if growing or generation in stored:
                return stored.get(generation)
            return complete_metrics(archive, self.of(archive, generation))
        except StorageError:  # reported by `of`, to requests for behaviors
            return None

    def stored_measures(self) -> dict[int, CorrectedMetrics]:
        """Return the corrected metrics that are stored, by generation; none if they cannot be read."""
        try:
            return {m.generation: m.corrected for m in self._rows().measured}
        except StorageError:  # reported by `of`, to requests for behaviors
            return {}

    def changed(self) -> bool:
        """Whether the file of re-evaluations has changed since it was last read."""
        return self._signature is not None and self._signature != self._look()

    def _rows(self) -> Reevaluations:
        signature = self._look()
        if signature != self._signature:
            self._signature = signature
            try:
                self._read = Reevaluations.load(self._repertoire, self._run_id, self._dimensions)
            except StorageError as error:
                self._read = error
        if isinstance(self._read, StorageError):
            raise self._read
        return self._read

    def _look(self) -> tuple[int, int, int]:
        """Return a signature that changes whenever the file is replaced; zeros while there is none."""
        try:
            found = self._file.stat()
        except OSError:
            return 0, 0, 0
        return found.st_ino, found.st_mtime_ns, found.st_size
