"""What an archive manager knows from re-evaluations: read again when their file or the archive has changed."""

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
        run_id: Its run.
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
            generation: Its last generation, by which it is known to have changed.

        Raises:
            StorageError: The file of re-evaluations is damaged, of another run or cannot be read.
        """
        rows = self._rows()
        state = (self._signature, generation, id(archive))
        if self._statistics is None or state != self._state:
            self._statistics, self._state = rows.statistics(archive), state
        return self._statistics

    def measures(
        self, archive: Archive, generation: int, *, growing: bool
    ) -> CorrectedMetrics | None:
        """Return what the archive is worth by re-evaluations of all of its elites, None while it is not known.

        Args:
            archive: The archive as it is now.
            generation: Its last generation.
            growing: Whether a run adds to it: then what is not stored as measured is not known, as it has changed
                since.
        """
        try:
            stored = {m.generation: m.corrected for m in self._rows().measured}
            if growing or generation in stored:
                return stored.get(generation)
            return complete_metrics(archive, self.of(archive, generation))
        except StorageError:  # said by `of`, to those who ask for a behavior
            return None

    def changed(self) -> bool:
        """Whether the file of re-evaluations is another one than when it was last read."""
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
        """Return what changes whenever the file is replaced; zeros while there is none."""
        try:
            found = self._file.stat()
        except OSError:
            return 0, 0, 0
        return found.st_ino, found.st_mtime_ns, found.st_size
