"""Tables that newer repertoire files have: the worst and the best elite of every generation."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.metrics import UNKNOWN, Metrics
from pga_me_ros.core.storage.rows import (
    EXTREMES,
    KEPT_SOLUTION,
    DamagedRow,
    extremes_digest_of,
    row_to_elite,
)

EXTREMES_SCHEMA = f"""
CREATE TABLE IF NOT EXISTS extremes (
    generation INTEGER PRIMARY KEY,
    min_fitness REAL NOT NULL,         -- of the worst elite after it
    best_evaluation INTEGER NOT NULL,  -- evaluation id of the best elite after it
    digest BLOB NOT NULL               -- SHA-256 of the row
);
CREATE TABLE IF NOT EXISTS bests ({KEPT_SOLUTION});
"""
"""`extremes` belongs to `generations`; `bests` keeps every elite that was ever the best one, even if another has taken
its cell since. Older files gain these tables when opened for writing."""

GENERATIONS = (
    "SELECT g.*, e.min_fitness, e.best_evaluation, e.digest FROM generations g "
    "LEFT JOIN extremes e USING (generation)"
)
OLDER_GENERATIONS = "SELECT g.*, NULL, NULL, NULL FROM generations g"
"""The same for a file without the table `extremes`."""


def has_extremes(connection: sqlite3.Connection) -> bool:
    """Whether a file has these tables; older files do not."""
    query = "SELECT count(*) FROM sqlite_schema WHERE name IN ('extremes', 'bests')"
    return bool(connection.execute(query).fetchone()[0] == 2)


def require_whole(metrics: Sequence[Metrics], first: int) -> None:
    """Make sure that no generation is missing, nor its extremes.

    Args:
        metrics: Those that a file has, in order.
        first: Number of the first generation.

    Raises:
        DamagedRow: One is missing.
    """
    if [m.generation for m in metrics] != list(range(first, first + len(metrics))):
        raise DamagedRow("the row of a generation is missing")
    known = [m.best_evaluation != UNKNOWN for m in metrics]
    if known != sorted(known):  # every generation after the first that has them has them, too
        raise DamagedRow("the row of extremes of a generation is missing")


def store_extremes(connection: sqlite3.Connection, metrics: Metrics) -> None:
    """Store the extremes of a generation, after its elites and within their transaction."""
    if metrics.best_evaluation == UNKNOWN:
        return
    columns = (metrics.generation, *(getattr(metrics, name) for name in EXTREMES))
    row = (*columns, extremes_digest_of(columns))
    connection.execute("INSERT OR REPLACE INTO extremes VALUES (?, ?, ?, ?)", row)
    keep = "INSERT OR IGNORE INTO bests SELECT * FROM elites WHERE evaluation = ?"
    connection.execute(keep, (metrics.best_evaluation,))


def read_bests(connection: sqlite3.Connection, archive: Archive) -> list[Elite]:
    """Return every elite that was the best one after some generation, in the order they were found.

    Args:
        connection: The file.
        archive: Archive with the file's geometry.

    Raises:
        DamagedRow: A row is damaged or missing.
    """
    if not has_extremes(connection):
        return []
    wanted = "SELECT DISTINCT best_evaluation FROM extremes ORDER BY best_evaluation"
    evaluations = [row[0] for row in connection.execute(wanted)]
    rows = connection.execute("SELECT * FROM bests ORDER BY evaluation")
    bests = [row_to_elite(row, archive) for row in rows]
    if [best.evaluation for best in bests] != evaluations:
        raise DamagedRow("a controller that was the best one is missing")
    return bests
