"""The repertoire file: elites, metrics and the run's identity in one SQLite database (WAL)."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.depth import CellDepth, DepthChange
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.storage.database import (
    connect,
    create_file,
    explained,
    insert_rows,
    require_no_loss,
    transaction,
)
from pga_me_ros.core.storage.deep_cells import read_depth, store_change
from pga_me_ros.core.storage.extremes import (
    GENERATIONS,
    OLDER_GENERATIONS,
    has_extremes,
    read_bests,
    store_extremes,
)
from pga_me_ros.core.storage.file_lock import FileLock
from pga_me_ros.core.storage.generation_files import generations_of
from pga_me_ros.core.storage.reading import read_archive, read_generations
from pga_me_ros.core.storage.rows import (
    DamagedRow,
    Generation,
    Row,
    elite_to_row,
    metrics_to_row,
    row_to_archive,
    row_to_generation,
    xor_digests,
)
from pga_me_ros.core.storage.run_info import SCHEMA_VERSION, RunInfo
from pga_me_ros.errors import StorageError

__all__ = ["SCHEMA_VERSION", "Repertoire", "RunInfo"]

PREDECESSOR_WAIT = 3.0
"""Seconds that a writer that is about to exit gets to release the file."""


class Repertoire:
    """An open repertoire file; made by `create` and `open`, closed by `close` or ``with``.

    A generation is committed whole, and once committed survives a power cut. One process at a time may write; any
    number may read meanwhile, and see whole generations only.

    Attributes:
        path: The file.
        read_only: Whether it was opened for reading.
        info: Identity of the run.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: FileLock | None) -> None:
        """Use `create` or `open` instead."""
        self.path = path
        self.read_only = lock is None
        self._connection = connection
        self._lock = lock
        with explained(path):
            self._generations = GENERATIONS if has_extremes(connection) else OLDER_GENERATIONS
            self.info, _ = row_to_archive(self._run_row())
            rows = connection.execute("SELECT cell, digest FROM elites").fetchall()
        self._digests: dict[int, bytes] = dict(rows)

    @classmethod
    def create(cls, path: str | Path, info: RunInfo, archive: Archive) -> Repertoire:
        """Make a new file without generations, and open it for writing.

        Args:
            path: The file; its folder is made if absent.
            info: Identity of the run.
            archive: Archive with the cells of the repertoire; its elites are not stored.

        Raises:
            StorageError: The file exists, or cannot be made.
        """
        path = Path(path)
        with explained(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = FileLock(Path(f"{path}.lock"))
            try:
                create_file(path, info, archive)
                return cls(path, connect(path, read_only=False), lock)
            except BaseException:
                lock.release()
                raise

    @classmethod
    def open(cls, path: str | Path, read_only: bool = False) -> Repertoire:
        """Open a file.

        Args:
            path: The file.
            read_only: Whether nothing will be committed; works while another process writes, and in read-only folders.

        Raises:
            StorageError: The file is missing, not a repertoire, damaged, of another schema version, not accessible, or
                being written by another process.
        """
        path = Path(path)
        # Listed first, because a writer may add to both meanwhile.
        with explained(path):
            stored = generations_of(path.parent / "experience", "experience")
        if read_only:
            return cls._opened(path, None, stored)
        if not path.is_file():
            connect(path, read_only=True)
        lock = FileLock(Path(f"{path}.lock"), wait=PREDECESSOR_WAIT)
        try:
            return cls._opened(path, lock, stored)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def _opened(cls, path: Path, lock: FileLock | None, stored: Sequence[int]) -> Repertoire:
        """Open a file whose run has stored experience of some generations; see `open`."""
        connection = connect(path, read_only=lock is None)
        try:
            repertoire = cls(path, connection, lock)
            require_no_loss(path, repertoire.last_generation, stored)
        except BaseException:
            connection.close()
            raise
        return repertoire

    @property
    def last_generation(self) -> int:
        """Number of the last committed generation, -1 for none.

        Raises:
            StorageError: The file is damaged.
        """
        last = self._last()
        return -1 if last is None else last.metrics.generation

    def commit(
        self,
        generation: int,
        elites: Sequence[Elite],
        metrics: Metrics,
        rates: Mapping[str, Any],
        change: DepthChange | None = None,
    ) -> bool:
        """Store a generation in one transaction; on return it survives a power cut.

        Args:
            generation: Number of the generation, from 0.
            elites: The elites of all cells that it changed.
            metrics: Its metrics.
            rates: The rates in force, fit for JSON.
            change: What it changed below the elites, where cells hold several solutions.

        Returns:
            False if that generation is stored already; nothing is changed then.

        Raises:
            StorageError: A generation is left out, the parts do not fit together, the file was opened for reading, or
                it cannot be written; then nothing of it is in the file.
        """
        if self._lock is None:
            raise StorageError(f"'{self.path}' was opened for reading; open it for writing.")
        last = self.last_generation
        if generation <= last:
            return False
        if generation != last + 1 or metrics.generation != generation:
            raise StorageError(
                f"'{self.path}' ends with generation {last}; the next is {last + 1}, not "
                f"{generation} with metrics of {metrics.generation}."
            )
        rows = [elite_to_row(elite) for elite in elites]
        digests = self._digests | {row[0]: row[-1] for row in rows}
        for cell in change.emptied_cells.tolist() if change else ():
            del digests[cell]
        if len(digests) != metrics.coverage:
            raise StorageError(
                f"Generation {generation} has a coverage of {metrics.coverage}, but '{self.path}' would hold "
                f"{len(digests)} elites; commit those of all changed cells."
            )
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        row = metrics_to_row(metrics, rates, now, xor_digests(list(digests.values())))
        with explained(self.path), transaction(self._connection, "IMMEDIATE"):
            insert_rows(self._connection, "elites", rows)
            insert_rows(self._connection, "generations", [row])
            if change:
                store_change(self._connection, generation, change)
            store_extremes(self._connection, metrics)
        self._digests = digests
        return True

    def load_archive(self) -> Archive:
        """Return the archive after the last committed generation, every row checked.

        Raises:
            StorageError: A row is damaged, missing or foreign.
        """
        with explained(self.path), transaction(self._connection, "DEFERRED"):
            return read_archive(self._connection, self._run_row(), self._last())

    def load_state(self) -> tuple[list[Generation], Archive]:
        """Return what `generations` and `load_archive` do, both of one state of a file that may be growing.

        Raises:
            StorageError: A row is damaged, missing or foreign.
        """
        with explained(self.path), transaction(self._connection, "DEFERRED"):
            generations = read_generations(self._connection, self._generations, 0, None)
            return generations, read_archive(self._connection, self._run_row(), self._last())

    def load_depth(self, archive: Archive, depth: int) -> CellDepth:
        """Return what the cells of `load_archive` hold below their elites, at most so many solutions each.

        Raises:
            StorageError: A row is damaged, missing or foreign.
        """
        with explained(self.path), transaction(self._connection, "DEFERRED"):
            return read_depth(self._connection, archive, depth, self.last_generation)

    def generations(self, first: int = 0, limit: int | None = None) -> list[Generation]:
        """Return what is stored about each generation besides its elites, in order.

        Args:
            first: Number of the first one to return.
            limit: Most to return, None for all.

        Raises:
            StorageError: A row is damaged or missing.
        """
        with explained(self.path):
            return read_generations(self._connection, self._generations, first, limit)

    def bests(self) -> list[Elite]:
        """Return every elite that was the best one after some generation, in the order they were found.

        They include elites that others have replaced since. For generations that an older version stored, they are
        unknown.

        Raises:
            StorageError: A row is damaged or missing.
        """
        with explained(self.path), transaction(self._connection, "DEFERRED"):
            _, archive = row_to_archive(self._run_row())
            return read_bests(self._connection, archive)

    def generation(self, generation: int) -> Generation:
        """Return what is stored about one generation besides its elites.

        Raises:
            StorageError: The row is damaged or missing.
        """
        with explained(self.path):
            query = f"{self._generations} WHERE generation = ?"
            row = self._connection.execute(query, (generation,)).fetchone()
            if row is None:
                raise DamagedRow(f"the row of generation {generation} is missing")
            return row_to_generation(row)

    def metrics(self) -> list[Metrics]:
        """Return the metrics of all generations, in order; raises as `generations` does."""
        return [generation.metrics for generation in self.generations()]

    def rates(self) -> list[dict[str, Any]]:
        """Return the rates that were in force in each generation, in order.

        Raises:
            StorageError: A row is damaged or missing.
        """
        return [generation.rates for generation in self.generations()]

    def result_digest(self) -> str:
        """Return the SHA-256 of cells and elites: equal for repertoires that are equal, bit for bit.

        It does not depend on times, the run's id or paths.

        Raises:
            StorageError: A row is damaged, missing or foreign.
        """
        return self.load_archive().digest()

    def close(self) -> None:
        """Close the file and let others write it; a second call does nothing."""
        with explained(self.path):
            self._connection.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Repertoire:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def _run_row(self) -> Row:
        query = "SELECT info, archive, centroids, digest FROM run"
        row: Row | None = self._connection.execute(query).fetchone()
        if row is None:
            raise DamagedRow("the run's description is missing")
        return row

    def _last(self) -> Generation | None:
        with explained(self.path):
            newest = f"{self._generations} ORDER BY generation DESC LIMIT 1"
            row = self._connection.execute(newest).fetchone()
            return None if row is None else row_to_generation(row)
