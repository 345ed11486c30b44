"""Opening SQLite files and explaining what is wrong with them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.storage.extremes import EXTREMES_SCHEMA, has_extremes
from pga_me_ros.core.storage.files import rename_file
from pga_me_ros.core.storage.rows import SCHEMA, DamagedRow, archive_to_row
from pga_me_ros.core.storage.run_info import READABLE_VERSIONS, SCHEMA_VERSION, RunInfo
from pga_me_ros.errors import StorageError

APPLICATION_ID = 0x5047414D
"""Marks a repertoire among SQLite files: "PGAM"."""

PAGE_SIZE = 16384
"""Bytes; a controller takes some 80 kB, so large pages save time."""

RESTORE = "Restore it from a copy, or start a new run in another folder."
BUSY_SECONDS = 10.0
_MAGIC = b"SQLite format 3\0"


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn errors of SQLite and the file system into messages that say what to do.

    Raises:
        StorageError: The block raised such an error.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise StorageError(f"'{path}': {_reason(error)}") from error
    except OSError as error:
        raise StorageError(
            f"'{path}': {error.strerror}. Check the folder, its permissions and the space on it."
        ) from error
    except DamagedRow as error:
        raise StorageError(f"'{path}' is damaged: {error}. {RESTORE}") from None


@contextmanager
def transaction(connection: sqlite3.Connection, kind: str) -> Iterator[None]:
    """Do what a block does in one transaction; if the block raises, nothing of it is in the file.

    Args:
        connection: The file.
        kind: DEFERRED to read one state of the file, IMMEDIATE to write.
    """
    connection.execute(f"BEGIN {kind}")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def insert_rows(
    connection: sqlite3.Connection, table: str, rows: Sequence[Sequence[object]]
) -> None:
    """Insert rows into a table, in place of those with the same key."""
    if rows:
        marks = ", ".join("?" * len(rows[0]))
        connection.executemany(f"INSERT OR REPLACE INTO {table} VALUES ({marks})", rows)


def _reason(error: sqlite3.Error) -> str:
    name = getattr(error, "sqlite_errorname", "")
    if name == "SQLITE_FULL":
        return "the disk is full. What was committed is safe; free some space and start again."
    if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
        return "another program keeps it locked. Close that program and try again."
    if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
        return f"it cannot be opened or written ({error}). Check permissions of file and folder."
    if name.startswith("SQLITE_PROTOCOL"):
        return (
            f"its file system does not support the file locks that SQLite needs ({error}). The file itself may be "
            "intact: copy it, with its '-wal' file if there is one, to a local disk and open the copy."
        )
    if name.startswith("SQLITE_IOERR"):
        return (
            f"reading or writing failed ({error}). What was committed is safe; check the disk and "
            "the space on it, and start again."
        )
    return f"it is damaged ({error}). {RESTORE}"


def connect(path: Path, read_only: bool) -> sqlite3.Connection:
    """Open a repertoire file and check that it is undamaged and of a known version.

    Raises:
        StorageError: The file is missing, not a repertoire, damaged, of another version, or unreadable.
    """
    with explained(path):
        _check_header(path)
        connection = _open_read_only(path) if read_only else _open(path, "mode=rw")
        try:
            _check(connection, path)
            if not read_only:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = FULL")
                if not has_extremes(connection):
                    connection.executescript(EXTREMES_SCHEMA)
        except BaseException:
            connection.close()
            raise
    return connection


def create_file(path: Path, info: RunInfo, archive: Archive) -> None:
    """Make a repertoire file without generations, under a temporary name first, so that it is never incomplete.

    Raises:
        StorageError: The file exists, or a log that SQLite would take for the file's.
        OSError: The folder cannot be written.
    """
    for present in (path, Path(f"{path}-wal")):
        if present.exists():
            raise StorageError(
                f"'{present}' exists already; resume its run or choose another folder."
            )
    new = Path(f"{path}.new")
    connection = _empty_file(new, info.schema_version)
    try:
        row = archive_to_row(info, archive)
        connection.execute("INSERT INTO run VALUES (0, ?, ?, ?, ?)", row)
    finally:
        connection.close()
    rename_file(new, path)


def require_no_loss(path: Path, last: int, stored: Sequence[int]) -> None:
    """Make sure that the file has all generations of its run.

    SQLite ignores a log that is damaged or gone, and shows an older state of the run as intact. Experience tells: a
    generation's is stored before the generation is committed, but never that of the generation after it.

    Raises:
        StorageError: There is experience of a later generation than the one after the file's last.
    """
    if stored and stored[-1] > last + 1:
        raise StorageError(
            f"'{path}' ends with generation {last}, but its run stored experience of generation "
            f"{stored[-1]}: what was committed since is lost. Its log '{path.name}-wal' is missing or "
            "damaged, or the file was replaced by an older copy. Restore the whole folder from a copy; to "
            f"use it as of generation {last}, copy the file elsewhere."
        )


def _empty_file(path: Path, schema_version: int) -> sqlite3.Connection:
    """Make a database with empty tables in a single file, for the caller to fill, close and rename."""
    for leftover in (path, Path(f"{path}-journal")):
        leftover.unlink(missing_ok=True)
    connection = _open(path, "mode=rwc")
    connection.execute(f"PRAGMA page_size = {PAGE_SIZE}")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {schema_version:d}")
    connection.executescript(SCHEMA + EXTREMES_SCHEMA)
    return connection


def _open(path: Path, query: str) -> sqlite3.Connection:
    uri = f"file:{quote(str(path.absolute()))}?{query}"
    # Transactions are begun and ended by hand; nodes may use the connection in another thread.
    return sqlite3.connect(
        uri, uri=True, isolation_level=None, timeout=BUSY_SECONDS, check_same_thread=False
    )


def _open_read_only(path: Path) -> sqlite3.Connection:
    connection = _open(path, "mode=ro")
    try:
        connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        return connection
    except sqlite3.OperationalError as error:
        connection.close()
        wal = Path(f"{path}-wal")
        forbidden = error.sqlite_errorname.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN"))
        # WAL needs a file next to the database. If it cannot be created, nobody is writing. But a log
        # that was left behind must not be ignored: it holds generations.
        if not forbidden or (wal.exists() and wal.stat().st_size > 0):
            raise
    return _open(path, "mode=ro&immutable=1")


def _check_header(path: Path) -> None:
    if not path.exists():
        raise StorageError(f"There is no repertoire '{path}'; check the path or start a run there.")
    if not path.is_file():
        raise StorageError(f"'{path}' is not a file; give the path of a repertoire file.")
    with path.open("rb") as file:
        magic = file.read(len(_MAGIC))
    if magic != _MAGIC:
        raise StorageError(f"'{path}' is not a repertoire file, or its beginning is damaged.")


def _check(connection: sqlite3.Connection, path: Path) -> None:
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    application_id = connection.execute("PRAGMA application_id").fetchone()[0]
    if application_id != APPLICATION_ID:
        raise StorageError(
            f"'{path}' is an SQLite database, but not a repertoire (or its mark is damaged)."
        )
    found = connection.execute("PRAGMA user_version").fetchone()[0]
    if found not in READABLE_VERSIONS:
        raise StorageError(
            f"'{path}' has schema version {found}, but this program reads {READABLE_VERSIONS[0]} to {SCHEMA_VERSION}. "
            "Use the pga_me_ros that wrote it."
        )
    report = [row[0] for row in connection.execute("PRAGMA quick_check(1)")]
    if report != ["ok"]:
        raise DamagedRow(report[0])
