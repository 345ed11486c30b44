"""What an archive manager knows from re-evaluations: read again when their file or the archive has changed."""

from __future__ import annotations

from pathlib import Path

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.storage.reevaluations import FILE, Reevaluations, Statistics
from pga_me_ros.errors import StorageError


class KnownStatistics:
    """Statistics of the elites that are served.

    Args:
        repertoire: The repertoire file; re-evaluations are next to it, if there are any.
        run_id: Its run.
    """

    def __init__(self, repertoire: Path, run_id: str) -> None:
        self._repertoire = repertoire
        self._file = repertoire.with_name(FILE)
        self._run_id = run_id
        self._state: tuple[object, ...] = ()
        self._found: Statistics | StorageError | None = None

    def of(self, archive: Archive, generation: int) -> Statistics:
        """Return the statistics of an archive's elites.

        Args:
            archive: The archive as it is now.
            generation: Its last generation, by which it is known to have changed.

        Raises:
            StorageError: The file of re-evaluations is damaged, of another run or cannot be read.
        """
        state = (self._signature(), generation, id(archive))
        if state != self._state:
            self._found, self._state = self._read(archive), state
        if isinstance(self._found, StorageError):
            raise self._found
        assert self._found is not None
        return self._found

    def _read(self, archive: Archive) -> Statistics | StorageError:
        try:
            rows = Reevaluations.load(self._repertoire, self._run_id, archive.dimensions)
        except StorageError as error:
            return error
        return rows.statistics(archive)

    def _signature(self) -> tuple[int, int, int]:
        """Return what changes whenever the file is replaced; zeros while there is none."""
        try:
            found = self._file.stat()
        except OSError:
            return 0, 0, 0
        return found.st_ino, found.st_mtime_ns, found.st_size
