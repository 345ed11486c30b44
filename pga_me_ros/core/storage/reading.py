"""What a repertoire file holds, read within a transaction of the caller, so that the parts are of one state."""

from __future__ import annotations

import sqlite3

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.storage.extremes import require_whole
from pga_me_ros.core.storage.rows import (
    DamagedRow,
    Generation,
    Row,
    row_to_archive,
    row_to_elite,
    row_to_generation,
    xor_digests,
)


def read_generations(
    connection: sqlite3.Connection, query: str, first: int, limit: int | None
) -> list[Generation]:
    """Return what is stored about each generation besides its elites, in order.

    Args:
        connection: The file.
        query: Selects the columns of generations.
        first: Number of the first one to return.
        limit: Most to return, None for all.

    Raises:
        DamagedRow: A row is damaged or missing.
    """
    found = connection.execute(
        f"{query} WHERE generation >= ? ORDER BY generation LIMIT ?",
        (first, -1 if limit is None else limit),
    )
    rows = [row_to_generation(row) for row in found]
    require_whole([row.metrics for row in rows], first)
    return rows


def read_archive(connection: sqlite3.Connection, run: Row, last: Generation | None) -> Archive:
    """Return the archive after the last generation, every row checked.

    Args:
        connection: The file.
        run: Its row about the run.
        last: Its last generation, None for none.

    Raises:
        DamagedRow: A row is damaged, missing or foreign.
    """
    _, archive = row_to_archive(run)
    digests = []
    for row in connection.execute("SELECT * FROM elites ORDER BY cell"):
        archive.put(row_to_elite(row, archive))
        digests.append(row[-1])
    expected = (0, xor_digests([]))
    if last is not None:
        expected = (last.metrics.coverage, last.elites_digest)
    if (len(archive), xor_digests(digests)) != expected:
        raise DamagedRow("its elites are not those of its last generation")
    return archive
