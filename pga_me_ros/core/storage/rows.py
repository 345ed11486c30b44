"""The tables of a repertoire file: their layout, and the conversion of rows to objects and back, with checksums.

Every row carries a SHA-256 of its own content. A generation's row also carries the XOR of the
digests of all elites at that time, which reveals a missing, stale or foreign elite.
"""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.make_archive import restore_archive
from pga_me_ros.core.archive.metrics import PER_OPERATOR, Metrics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import StorageError

KEPT_SOLUTION = """
    cell INTEGER NOT NULL,             -- these columns as in elites
    fitness REAL NOT NULL,
    evaluation INTEGER PRIMARY KEY,
    generation INTEGER NOT NULL,
    operator INTEGER NOT NULL,
    parent1 INTEGER NOT NULL,
    parent2 INTEGER NOT NULL,
    steps INTEGER NOT NULL,
    terminated INTEGER NOT NULL,
    descriptor BLOB NOT NULL,
    parameters BLOB NOT NULL,
    digest BLOB NOT NULL
"""
"""Columns of a table of solutions of which a cell may have several, or none."""

SCHEMA = """
CREATE TABLE run (
    id INTEGER PRIMARY KEY CHECK (id = 0), -- the one row
    info TEXT NOT NULL,       -- JSON: run_id, settings, task, layer_sizes, activations, versions
    archive TEXT NOT NULL,    -- JSON: kind, bins, low, high, parameter_count
    centroids BLOB NOT NULL,  -- float64 little endian, (cells, d) row by row
    digest BLOB NOT NULL      -- SHA-256 of the row
);
CREATE TABLE elites (
    cell INTEGER PRIMARY KEY,
    fitness REAL NOT NULL,        -- sum of rewards
    evaluation INTEGER NOT NULL,  -- id of its evaluation, counted from 0
    generation INTEGER NOT NULL,  -- generation that evaluated it
    operator INTEGER NOT NULL,    -- what made it: an Operator of core/operators.py
    parent1 INTEGER NOT NULL,     -- evaluation id of a parent, -1 for none
    parent2 INTEGER NOT NULL,
    steps INTEGER NOT NULL,       -- control steps of its episode
    terminated INTEGER NOT NULL,  -- 1 if it ended by falling, 0 if by the time limit
    descriptor BLOB NOT NULL,     -- float64 little endian, d numbers
    parameters BLOB NOT NULL,     -- float32 little endian, per layer weights (out, in), biases
    digest BLOB NOT NULL          -- SHA-256 of the row
);
CREATE TABLE generations (
    generation INTEGER PRIMARY KEY,
    evaluations INTEGER NOT NULL,   -- so far
    coverage INTEGER NOT NULL,      -- filled cells
    coverage_share REAL NOT NULL,   -- filled share of all cells
    qd_score REAL NOT NULL,         -- sum of fitness, no offset
    max_fitness REAL NOT NULL,
    mean_fitness REAL NOT NULL,
    steps INTEGER NOT NULL,         -- control steps of this generation
    total_steps INTEGER NOT NULL,   -- control steps so far
    offspring TEXT NOT NULL,        -- JSON: evaluated, by operator in the order of core/operators.py
    new_elites TEXT NOT NULL,       -- JSON: cells filled, by operator
    improved_elites TEXT NOT NULL,  -- JSON: elites replaced, by operator
    rates TEXT NOT NULL,            -- JSON: settings that may change during a run, as in force
    committed TEXT NOT NULL,        -- time of the commit, ISO 8601 in UTC
    elites_digest BLOB NOT NULL,    -- XOR of the digests of all elites after this generation
    digest BLOB NOT NULL            -- SHA-256 of the row
);
"""

DIGEST_SIZE = 32
EXTREMES = ("min_fitness", "best_evaluation")
"""Metrics that only newer files have, in a separate table (`core.storage.extremes`)."""
METRICS = tuple(f.name for f in fields(Metrics) if f.name not in EXTREMES)

Row = Sequence[Any]


class DamagedRow(Exception):  # noqa: N818 - a finding; the error that users see is `StorageError`
    """Something in a repertoire file differs from what was written."""


def archive_to_row(info: RunInfo, archive: Archive) -> tuple[str, str, bytes, bytes]:
    """Return the columns info, archive, centroids and digest of the run's row."""
    geometry = {
        "kind": archive.kind,
        "bins": archive.bins,
        "low": archive.low.tolist(),
        "high": archive.high.tolist(),
        "parameter_count": archive.parameter_count,
    }
    columns = (info.to_json(), json.dumps(geometry), archive.centroids.astype("<f8").tobytes())
    return (*columns, _run_digest(*columns))


def row_to_archive(row: Row) -> tuple[RunInfo, Archive]:
    """Return the description and the empty archive of `archive_to_row`.

    Raises:
        DamagedRow: The row is damaged.
    """
    info_text, geometry_text, centroids, digest = row
    try:
        sound = _run_digest(info_text, geometry_text, centroids) == digest
    except (TypeError, AttributeError):
        sound = False
    if not sound:
        raise DamagedRow("the run's description is damaged")
    geometry = json.loads(geometry_text)
    points = np.frombuffer(centroids, "<f8").reshape(-1, len(geometry["low"]))
    info = RunInfo.from_json(info_text)
    return info, restore_archive(geometry, points, info.schema_version)


def elite_to_row(elite: Elite) -> tuple[Any, ...]:
    """Return an elite's columns, the digest last."""
    return (
        elite.cell,
        elite.fitness,
        elite.evaluation,
        elite.generation,
        int(elite.operator),
        elite.parent1,
        elite.parent2,
        elite.steps,
        int(elite.terminated),
        np.asarray(elite.descriptor, "<f8").tobytes(),
        np.asarray(elite.parameters, "<f4").tobytes(),
        hashlib.sha256(elite.to_bytes()).digest(),
    )


def row_to_elite(row: Row, archive: Archive) -> Elite:
    """Return the elite of `elite_to_row`.

    Raises:
        DamagedRow: The row is damaged or does not fit the archive.
    """
    cell, fitness, evaluation, generation, operator, parent1, parent2, steps, terminated = row[:9]
    try:
        elite = Elite(
            cell=cell,
            fitness=fitness,
            descriptor=np.frombuffer(row[9], "<f8"),
            parameters=np.frombuffer(row[10], "<f4"),
            evaluation=evaluation,
            generation=generation,
            operator=Operator(operator),
            parent1=parent1,
            parent2=parent2,
            steps=steps,
            terminated=bool(terminated),
        )
        sound = hashlib.sha256(elite.to_bytes()).digest() == row[11]
    except (TypeError, ValueError, struct.error):
        sound = False
    if not sound:
        raise DamagedRow(f"the elite of cell {cell!r} is damaged")
    shapes = (elite.descriptor.shape, elite.parameters.shape)
    if shapes != ((archive.dimensions,), (archive.parameter_count,)) or cell >= archive.cells:
        raise DamagedRow(f"the elite of cell {cell} does not fit the archive")
    return elite


def metrics_to_row(
    metrics: Metrics, rates: Mapping[str, Any], committed: str, elites_digest: bytes
) -> tuple[Any, ...]:
    """Return the columns of a generation, the digest last.

    Raises:
        StorageError: A metric or rate is not finite.
    """
    columns = [getattr(metrics, name) for name in METRICS]
    try:
        columns = [json.dumps(v) if isinstance(v, tuple) else v for v in columns]
        columns += [json.dumps(dict(rates), sort_keys=True, allow_nan=False), committed]
        return (*columns, elites_digest, _generation_digest(columns, elites_digest))
    except (TypeError, ValueError) as error:
        raise StorageError(
            f"Metrics or rates of generation {metrics.generation} cannot be stored ({error}); "
            "every number must be finite."
        ) from None


@dataclass(frozen=True)
class Generation:
    """What a repertoire file holds about one generation.

    Attributes:
        metrics: Its metrics.
        rates: The rates that were in force.
        committed: Time of the commit, ISO 8601 in UTC.
        elites_digest: XOR of the digests of all elites after it.
    """

    metrics: Metrics
    rates: dict[str, Any]
    committed: str
    elites_digest: bytes


def row_to_generation(row: Row) -> Generation:
    """Return the generation from the columns of `metrics_to_row`.

    Args:
        row: Its columns, followed by those of the table `extremes` without the generation, all None if unknown.

    Raises:
        DamagedRow: The row is damaged.
    """
    *row, min_fitness, best_evaluation, extremes_digest = row
    *columns, elites_digest, digest = row
    try:
        sound = _generation_digest(columns, elites_digest) == digest
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise DamagedRow(f"the row of generation {row[0]!r} is damaged")
    values = dict(zip(METRICS, columns, strict=False))
    values |= {name: tuple(json.loads(values[name])) for name in PER_OPERATOR}
    if extremes_digest is not None:
        extremes = (row[0], min_fitness, best_evaluation)
        if extremes_digest_of(extremes) != extremes_digest:
            raise DamagedRow(f"the row of extremes of generation {row[0]!r} is damaged")
        values |= dict(zip(EXTREMES, extremes[1:], strict=True))
    rates, committed = columns[len(METRICS) :]
    return Generation(Metrics(**values), json.loads(rates), committed, elites_digest)


def xor_digests(digests: Sequence[bytes]) -> bytes:
    """Return the XOR of SHA-256 digests, zeros for none: a digest of a set of rows."""
    total = 0
    for digest in digests:
        total ^= int.from_bytes(digest, "little")
    return total.to_bytes(DIGEST_SIZE, "little")


def extremes_digest_of(columns: Sequence[Any]) -> bytes:
    """Return the digest of a row of the table `extremes`, given without it."""
    return hashlib.sha256(repr(tuple(columns)).encode()).digest()


def _run_digest(info: str, geometry: str, centroids: bytes) -> bytes:
    return hashlib.sha256(b"\0".join([info.encode(), geometry.encode(), centroids])).digest()


def _generation_digest(columns: Sequence[Any], elites_digest: bytes) -> bytes:
    text = json.dumps(list(columns), allow_nan=False)
    return hashlib.sha256(text.encode() + elites_digest).digest()
