"""The content of a run's files, read without the package, which must not judge itself."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pybullet_data
import torch
from pybullet_utils.bullet_client import BulletClient

ELITES = (
    "cell",
    "fitness",
    "evaluation",
    "generation",
    "operator",
    "parent1",
    "parent2",
    "steps",
    "terminated",
    "descriptor",
    "parameters",
)
METRICS = (
    "generation",
    "evaluations",
    "coverage",
    "coverage_share",
    "qd_score",
    "max_fitness",
    "mean_fitness",
    "steps",
    "total_steps",
)
PER_OPERATOR = ("offspring", "new_elites", "improved_elites")
EXTREMES = ("generation", "min_fitness", "best_evaluation")

Row = dict[str, Any]


def elites_of(run: Path) -> list[Row]:
    """Return the elites of a run by column, in the order of their cells; descriptors and parameters as arrays."""
    rows = _rows(run, "elites", ELITES, "cell")
    for row in rows:
        row["descriptor"] = np.frombuffer(row["descriptor"], "<f8")
        row["parameters"] = np.frombuffer(row["parameters"], "<f4")
    return rows


def generations_of(run: Path) -> list[Row]:
    """Return the metrics of a run's generations by column; counts per operator without operators that made none."""
    rows = _rows(run, "generations", METRICS + PER_OPERATOR, "generation")
    extremes = _rows(run, "extremes", EXTREMES, "generation")
    for row, more in zip(rows, extremes, strict=True):
        row |= more
        for name in PER_OPERATOR:
            counts = json.loads(row[name])
            row[name] = [[place, count] for place, count in enumerate(counts) if count]
    return rows


def run_info_of(run: Path) -> Row:
    """Return the description of a run: its id, settings, task and so on."""
    return json.loads(_rows(run, "run", ("info",), "id")[0]["info"])


def result_digest(run: Path) -> str:
    """Return a digest of elites and metrics that does not depend on their names and layout."""
    out = hashlib.sha256()
    for row in elites_of(run):
        numbers = [row[name] for name in ELITES[:-2]]
        out.update(repr(numbers).encode())
        out.update(row["descriptor"].tobytes() + row["parameters"].tobytes())
    for row in generations_of(run):
        out.update(repr(list(row.values())).encode())
    return out.hexdigest()


def machine_digest() -> str:
    """Return a digest of this machine's results for sums like those of a run.

    The bits of a result are valid for one type of machine and one set of library versions, as is this digest.
    """
    rng = np.random.default_rng(0)
    out = hashlib.sha256()
    with torch.no_grad():
        for sizes in ((15, 8, 8, 3), (18, 8, 8, 1), (26, 8, 8, 6)):
            signal, rows = rng.standard_normal((2, sizes[0])), rng.standard_normal((16, sizes[0]))
            one, batch = signal[0].astype(np.float32), torch.from_numpy(rows).float()
            for n_in, n_out in pairwise(sizes):
                weights = rng.standard_normal((n_in, n_out)).astype(np.float32)
                one = np.tanh(np.dot(one, weights))
                batch = torch.tanh(torch.addmm(torch.ones(n_out), batch, torch.from_numpy(weights)))
            out.update(
                one.tobytes() + batch.numpy().tobytes() + batch.sqrt().mean(0).numpy().tobytes()
            )
    out.update(np.exp(rng.standard_normal(1000)).tobytes())
    client = BulletClient(pybullet.DIRECT)
    (robot, *_) = client.loadMJCF(f"{pybullet_data.getDataPath()}/mjcf/hopper.xml")[::-1]
    client.setGravity(0, 0, -9.8)
    for _ in range(200):
        client.stepSimulation()
    out.update(repr(client.getLinkState(robot, 2)).encode())
    client.disconnect()
    return out.hexdigest()


def _rows(run: Path, table: str, columns: Sequence[str], order: str) -> list[Row]:
    """Read a table; give the folder of a copy, as SQLite may leave files next to a repertoire that it reads."""
    file = run / "repertoire.db"
    with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as connection:
        rows = connection.execute(f"SELECT {', '.join(columns)} FROM {table} ORDER BY {order}")
        return [dict(zip(columns, row, strict=True)) for row in rows]
