"""Writing the repertoire file of a search that ran without one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.depth import CellDepth
from pga_me_ros.core.archive.metrics import UNKNOWN, Metrics
from pga_me_ros.core.storage.database import connect, create_file, explained, insert_rows
from pga_me_ros.core.storage.deep_cells import store_change
from pga_me_ros.core.storage.extremes import store_extremes
from pga_me_ros.core.storage.rows import elite_to_row, metrics_to_row, xor_digests
from pga_me_ros.core.storage.run_info import RunInfo


def store_whole_run(
    path: Path,
    info: RunInfo,
    archive: Archive,
    metrics: Sequence[Metrics],
    rates: Mapping[str, Any],
    *,
    depth: CellDepth | None = None,
    closed: bool = False,
) -> None:
    """Make a repertoire file of an archive and the metrics of its generations.

    It lacks what can no longer be known: the elites that were replaced, and so the best and the worst elite of every
    generation but the last.

    Args:
        path: The file; its folder is made if absent.
        info: Identity of the run.
        archive: The archive after the last generation.
        metrics: Metrics of every generation, at least one.
        rates: The rates in force, stored with every generation.
        depth: What the archive's cells hold below their elites, where solutions are evaluated again.
        closed: Whether nothing will ever be added, so that the file can do without a log beside it, and be read where
            nothing can be written.

    Raises:
        StorageError: The file exists or cannot be written.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    elites = [elite_to_row(elite) for elite in archive.elites()]
    without = [
        dataclasses.replace(m, min_fitness=math.nan, best_evaluation=UNKNOWN) for m in metrics[:-1]
    ]
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        create_file(path, info, archive)
        connection = connect(path, read_only=False)
        try:
            connection.execute("BEGIN IMMEDIATE")
            insert_rows(connection, "elites", elites)
            for generation in (*without, metrics[-1]):
                last = generation is metrics[-1]
                digest = xor_digests([row[-1] for row in elites] if last else [])
                row = metrics_to_row(generation, rates, now, digest)
                insert_rows(connection, "generations", [row])
            store_extremes(connection, metrics[-1])
            if depth:
                store_change(connection, metrics[-1].generation, depth.everything)
            connection.execute("COMMIT")
            if closed:
                connection.execute("PRAGMA journal_mode = DELETE")
        finally:
            connection.close()
