"""The tables of a repertoire file for cells that hold several solutions, and for all evaluations of each."""

from __future__ import annotations

import hashlib
import sqlite3
import struct

import numpy as np

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.depth import CellDepth, DepthChange, Samples
from pga_me_ros.core.storage.database import insert_rows
from pga_me_ros.core.storage.rows import (
    DIGEST_SIZE,
    KEPT_SOLUTION,
    DamagedRow,
    elite_to_row,
    row_to_elite,
    xor_digests,
)

DEEP_CELLS_SCHEMA = f"""
CREATE TABLE IF NOT EXISTS below ({KEPT_SOLUTION});
CREATE TABLE IF NOT EXISTS samples (
    evaluation INTEGER PRIMARY KEY,    -- by which the archive knows the solution
    count INTEGER NOT NULL,            -- its evaluations
    fitness REAL NOT NULL,             -- sum of their fitness
    descriptor BLOB NOT NULL,          -- float64 little endian, d sums
    digest BLOB NOT NULL               -- SHA-256 of the row
);
CREATE TABLE IF NOT EXISTS deep_generations (
    generation INTEGER PRIMARY KEY,
    digest BLOB NOT NULL               -- XOR of the digests of all rows of both tables after it
);
"""
"""Tables of runs with `extract_share`; the others lack them."""


def store_change(connection: sqlite3.Connection, generation: int, change: DepthChange) -> None:
    """Store what a generation changed besides the elites that are new or have another estimate, within its transaction.

    Raises:
        sqlite3.Error: The file cannot be written.
    """
    for statement in filter(None, (s.strip() for s in DEEP_CELLS_SCHEMA.split(";"))):
        connection.execute(statement)
    _delete(connection, "elites", "cell", change.emptied_cells.tolist())
    _delete(connection, "below", "evaluation", change.left)
    _delete(connection, "samples", "evaluation", change.forgotten)
    samples = [_samples_row(k, samples) for k, samples in change.samples.items()]
    insert_rows(connection, "below", [elite_to_row(solution) for solution in change.below])
    insert_rows(connection, "samples", samples)
    insert_rows(connection, "deep_generations", [(generation, _digest(connection))])


def read_depth(
    connection: sqlite3.Connection, archive: Archive, depth: int, generation: int
) -> CellDepth:
    """Return what cells hold below their elites, and all evaluations.

    Args:
        connection: The file.
        archive: Its archive, with all elites.
        depth: Most solutions of a cell.
        generation: Its last generation, -1 for none.

    Raises:
        DamagedRow: A row is damaged, missing or foreign.
    """
    deep = CellDepth(archive, depth)
    if generation < 0:
        return deep
    found = connection.execute(
        "SELECT digest FROM deep_generations WHERE generation = ?", (generation,)
    ).fetchone()
    if found is None or found[0] != _digest(connection):
        raise DamagedRow(
            "what its cells hold below their elites is not that of its last generation"
        )
    below = [row_to_elite(row, archive) for row in connection.execute("SELECT * FROM below")]
    rows = connection.execute("SELECT * FROM samples").fetchall()
    samples = dict(_row_to_samples(row, archive) for row in rows)
    held = {s.evaluation for s in below} | set(archive.evaluations[archive.filled].tolist())
    if samples.keys() != held:
        raise DamagedRow("the evaluations of a solution are missing")
    deep.restore(below, samples)
    return deep


def _delete(
    connection: sqlite3.Connection, table: str, column: str, values: list[int] | tuple[int, ...]
) -> None:
    connection.executemany(f"DELETE FROM {table} WHERE {column} = ?", [(v,) for v in values])


def _samples_row(evaluation: int, samples: Samples) -> tuple[object, ...]:
    columns = (
        evaluation,
        samples.count,
        samples.fitness + 0.0,
        np.asarray(samples.descriptor + 0.0, "<f8").tobytes(),
    )
    return (*columns, _samples_digest(*columns))


def _samples_digest(evaluation: int, count: int, fitness: float, descriptor: bytes) -> bytes:
    return hashlib.sha256(struct.pack("<qqd", evaluation, count, fitness) + descriptor).digest()


def _row_to_samples(
    row: tuple[int, int, float, bytes, bytes], archive: Archive
) -> tuple[int, Samples]:
    evaluation, count, fitness, descriptor, digest = row
    try:
        sound = _samples_digest(evaluation, count, fitness, descriptor) == digest
    except (TypeError, struct.error):
        sound = False
    if not sound or len(descriptor) != 8 * archive.dimensions:
        raise DamagedRow(f"the evaluations of solution {evaluation!r} are damaged")
    return evaluation, Samples(count, fitness, np.frombuffer(descriptor, "<f8").copy())


def _digest(connection: sqlite3.Connection) -> bytes:
    """Return the XOR of the digests of all rows."""
    rows = connection.execute("SELECT digest FROM below UNION ALL SELECT digest FROM samples")
    digests = [row[0] for row in rows]
    if any(len(digest) != DIGEST_SIZE for digest in digests):
        raise DamagedRow("a digest is damaged")
    return xor_digests(digests)
