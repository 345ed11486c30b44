"""Trials on disk: an adapter that is restarted knows what its robot has tried."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pga_me_ros.core.adaptation.adaptation import Trial
from pga_me_ros.core.storage.file_lock import FileLock, LockedError
from pga_me_ros.errors import StorageError

_SCHEMA = """
CREATE TABLE IF NOT EXISTS adaptation (
    id INTEGER PRIMARY KEY, run_id TEXT NOT NULL, task TEXT NOT NULL, budget INTEGER NOT NULL,
    min_fitness REAL NOT NULL, max_fall_share REAL NOT NULL);
CREATE TABLE IF NOT EXISTS trial (
    adaptation INTEGER NOT NULL REFERENCES adaptation, number INTEGER NOT NULL, cell INTEGER NOT NULL,
    evaluation INTEGER NOT NULL, descriptor TEXT NOT NULL, promised REAL NOT NULL, expected REAL NOT NULL,
    uncertainty REAL NOT NULL, achieved REAL, given_up INTEGER NOT NULL, PRIMARY KEY (adaptation, number));
"""

_TABLES = {"adaptation", "trial"}

NO_MINIMUM = -1e308
"""A least fitness that is none: what `adapt/start` has by default."""

_BUSY = 2.0
"""Seconds to wait for another process that writes the file."""


@dataclass(frozen=True)
class Undertaking:
    """An adaptation that was started.

    Attributes:
        run_id: Run that grew the repertoire.
        task: Name of its task.
        budget: Most trials.
        min_fitness: Least fitness that a behavior must promise, -1e308 for none.
        max_fall_share: Greatest share of falls, negative for none.
        id: Its row in the file.
    """

    run_id: str
    task: str
    budget: int
    min_fitness: float
    max_fall_share: float
    id: int = 0

    @property
    def limits(self) -> dict[str, float]:
        """The limits that there are, by name."""
        limits = {}
        if not self.min_fitness <= NO_MINIMUM:
            limits["min_fitness"] = self.min_fitness
        if not self.max_fall_share < 0.0:
            limits["max_fall_share"] = self.max_fall_share
        return limits

    @property
    def limits_in_words(self) -> str:
        """The limits for people."""
        words = [f"{name} {value:g}" for name, value in self.limits.items()]
        return ", ".join(words) or "no limits"


def lock(path: Path) -> FileLock:
    """Return the lock of a memory, which the adapter of one robot holds for as long as it runs.

    Args:
        path: The memory's file; the lock is beside it.

    Raises:
        StorageError: Another adapter works with the file, or it cannot be locked.
    """
    try:
        return FileLock(path.with_name(f"{path.name}.lock"), _BUSY)
    except LockedError as error:
        raise StorageError(
            f"The memory '{path}' is that of another adapter that runs ({error.holder}), and so of another robot; name "
            "a file of this one by -p memory:=FILE."
        ) from None


class Memory:
    """A SQLite file with all adaptations of a robot and their trials; each change is on disk when a call returns.

    Args:
        path: The file; it is made if it is not there.

    Raises:
        StorageError: It cannot be opened or is no such file; it is then left as it is.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = sqlite3.connect(path, timeout=_BUSY)
            self._require_own()
            self._file.executescript(_SCHEMA)
        except sqlite3.Error as error:
            raise self._failure("opened", error) from error

    def _require_own(self) -> None:
        """Make sure that the file is empty or a memory.

        Raises:
            StorageError: It has other tables.
        """
        rows = self._file.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"
        )
        if others := sorted({name for (name,) in rows} - _TABLES):
            self._file.close()
            raise StorageError(
                f"'{self._path}' is no memory of an adapter: it is a SQLite file with {', '.join(others[:3])}; name a "
                "memory, or a new file, by -p memory:=FILE."
            )

    def last(self) -> tuple[Undertaking, list[Trial]] | None:
        """Return the adaptation that was started last, with its trials; None if there was none.

        Raises:
            StorageError: The file cannot be read.
        """
        try:
            row = self._file.execute(
                "SELECT run_id, task, budget, min_fitness, max_fall_share, id FROM adaptation ORDER BY id DESC LIMIT 1"
            ).fetchone()
            if row is None:
                return None
            rows = self._file.execute(
                "SELECT number, cell, evaluation, descriptor, promised, expected, uncertainty, achieved, given_up "
                "FROM trial WHERE adaptation = ? ORDER BY number",
                (row[-1],),
            ).fetchall()
            return Undertaking(*row), [_trial(values) for values in rows]
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise self._failure("read", error) from error

    def start(self, undertaking: Undertaking) -> Undertaking:
        """Store a new adaptation; returns it with its row.

        Raises:
            StorageError: The file cannot be written.
        """
        u = undertaking
        values = (u.run_id, u.task, u.budget, u.min_fitness, u.max_fall_share)
        row = self._write(
            "INSERT INTO adaptation (run_id, task, budget, min_fitness, max_fall_share) VALUES (?, ?, ?, ?, ?)",
            values,
        )
        return Undertaking(*values, row)

    def change_budget(self, undertaking: Undertaking) -> None:
        """Store the budget of an adaptation that is in the file with another.

        Raises:
            StorageError: The file cannot be written.
        """
        values = (undertaking.budget, undertaking.id)
        self._write("UPDATE adaptation SET budget = ? WHERE id = ?", values)

    def store(self, undertaking: Undertaking, trial: Trial) -> None:
        """Store a trial, or what became of it.

        Raises:
            StorageError: The file cannot be written.
        """
        self._write(
            "INSERT OR REPLACE INTO trial VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                undertaking.id,
                trial.number,
                trial.cell,
                trial.evaluation,
                json.dumps(trial.descriptor.tolist()),
                trial.promised,
                trial.expected,
                trial.uncertainty,
                trial.achieved,
                int(trial.given_up),
            ),
        )

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, statement: str, values: tuple[object, ...]) -> int:
        try:
            with self._file:
                return self._file.execute(statement, values).lastrowid or 0
        except sqlite3.Error as error:
            raise self._failure("written", error) from error

    def _failure(self, what: str, error: Exception) -> StorageError:
        return StorageError(
            f"The memory '{self._path}' cannot be {what} ({error}); name another file by -p memory:=FILE."
        )


def _trial(values: tuple[object, ...]) -> Trial:
    number, cell, evaluation, descriptor, promised, expected, uncertainty, achieved, given_up = (
        values
    )
    return Trial(
        int(str(number)),
        int(str(cell)),
        int(str(evaluation)),
        np.array(json.loads(str(descriptor)), np.float64),
        float(str(promised)),
        float(str(expected)),
        float(str(uncertainty)),
        None if achieved is None else float(str(achieved)),
        bool(given_up),
    )
