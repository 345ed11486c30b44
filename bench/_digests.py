"""The runs that `same_bits.py` compares, as a program that prints their digests as JSON. Not a bench itself.

It is run once per source tree, with that tree first in PYTHONPATH. So it uses only what every version has in the same
place: `Search`, `Settings`, the tasks, the orchestrator, and the files of a run, read by SQLite and by their layout.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
from domain_coordinator import domain_id

import pga_me_ros
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import load_task

Digests = dict[str, list[str]]
"""Digests of a run by part; a part may have one per generation, in order."""

COMMON = {"seed": 11, "controller_hidden": (8, 8)}
CRITICS = {
    "transition_batch": 32,
    "critic_hidden": (16, 16),
    "replay_size": 3000,  # transitions; some runs overwrite the first ones
}
PG = {**CRITICS, "n_crit": 11, "n_grad": 3}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "pga_map_elites": {"batch_size": 7, "n_evo": 3, **PG},
    "map_elites": {"batch_size": 7, "n_evo": 7},
    "pg_only": {"batch_size": 7, "n_evo": 0, **PG},
    "td3": {"batch_size": 2, **CRITICS},
    "map_elites_es": {"es_samples": 6, "batch_size": 7, "es_steps": 2, "es_neighbors": 3},
    "qd_rl": {"batch_size": 5, "novelty_neighbors": 3, "state_archive_size": 300, **PG},
    "dcrl_map_elites": {"batch_size": 7, "n_evo": 3, **PG},
}
TASKS: dict[str, dict[str, Any]] = {
    "qd_hopper": {"cells": 40, "cvt_samples": 2000},
    "qd_ant": {"archive": "grid"},
}

GENERATIONS = {"qd_hopper": 12, "qd_ant": 5}
"""An episode of the ant is always 1000 steps long; a hopper falls much earlier."""
RANDOM_GENERATIONS = 2

OTHER_CHOICES = {
    "schedule": "alternating",
    "greedy_init": "best",
    "greedy_takes": "ga",
    "line_noise": "tensor",
    "pg_batches": "own",
    "terminal": "bootstrap",
    "target_action": "free",
}
"""PGA-MAP-Elites runs with the defaults on one task and with these on the other."""

GRAPH = ("pga_map_elites", "qd_hopper")
GRAPH_TIMEOUT = 300.0
"""Seconds."""

LINEAGE = ("cell", "evaluation", "generation", "operator", "parent1", "parent2")
EPISODE = ("steps", "terminated")
NOT_RESULT = ("rates", "committed", "elites_digest", "digest")
"""Columns of a repertoire file that hold settings, times or sums of other columns."""

MAGIC = b"PGAMECK1"


def values_of(algorithm: str, task: str) -> dict[str, Any]:
    """Return the settings of a run."""
    chosen: dict[str, Any] = {**COMMON, **ALGORITHMS[algorithm], **TASKS[task]}
    chosen["evaluations"] = GENERATIONS[task] * chosen["batch_size"]
    if algorithm != "map_elites_es":  # it starts with a single controller
        chosen["random_init"] = RANDOM_GENERATIONS * chosen["batch_size"]
    if (algorithm, task) == ("pga_map_elites", "qd_ant"):
        chosen |= OTHER_CHOICES
    return {"algorithm": algorithm, "task": task, **chosen}


def is_known(algorithm: str) -> bool:
    """Whether the version that is imported has an algorithm."""
    try:
        Settings.from_mapping({"algorithm": algorithm})
    except ValueError:
        return False
    return True


def of_known_operators(counts: Any) -> Any:
    """Return counts per operator without the zeros at their end: an operator that came later made nothing."""
    if not isinstance(counts, tuple):
        return counts
    return counts[: max((i + 1 for i, n in enumerate(counts) if n), default=0)]


def digest(*values: Any) -> str:
    """Return a digest of numbers, arrays, text and bytes, including types and shapes."""
    out = hashlib.sha256()
    for value in values:
        if isinstance(value, str | bytes):
            out.update(value.encode() if isinstance(value, str) else value)
            continue
        array = np.asarray(value)
        out.update(f"{array.dtype.str}{array.shape}".encode())
        out.update(array.tobytes())
    return out.hexdigest()


def digest_of_contents(arrays: Iterable[np.ndarray]) -> str:
    """Return a digest of arrays that does not depend on their names or order."""
    return digest(*sorted(digest(array) for array in arrays))


class RecordedSearch(Search):
    """A search that digests everything it evaluates."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.digests: Digests = {"offspring": [], "lineage": [], "episodes": [], "metrics": []}

    def tell(self, batch: Any, episodes: Sequence[Any]) -> Any:
        """Digest a generation, then learn from it."""
        metrics = super().tell(batch, episodes)
        parts = [
            part
            for e in episodes
            for part in (e.states, e.actions, e.rewards, e.fitness, e.descriptor, e.terminated)
        ]
        numbers = [of_known_operators(value) for _, value in sorted(asdict(metrics).items())]
        self.digests["offspring"].append(digest(batch.parameters))
        self.digests["lineage"].append(
            digest(list(batch.evaluations), batch.operators, batch.parents)
        )
        self.digests["episodes"].append(digest(*parts))
        self.digests["metrics"].append(digest(*numbers))
        return metrics


def search(algorithm: str, task_name: str) -> Digests:
    """Carry out a run in this process."""
    settings = Settings.from_mapping(values_of(algorithm, task_name))
    task = load_task(task_name)()
    try:
        run = RecordedSearch(task.spec, settings)
        while run.generation < settings.generations:
            run.run_generation(task)
    finally:
        task.close()
    elites = [vars(elite) for elite in run.archive.elites()]
    return {
        **run.digests,
        "elites' parameters": [digest(*(e["parameters"] for e in elites))],
        "elites' fitness": [digest(*(e["fitness"] for e in elites))],
        "elites' descriptors": [digest(*(e["descriptor"] for e in elites))],
        "elites' lineage": [digest(*(int(e[n]) for e in elites for n in (*LINEAGE, *EPISODE)))],
        # map_elites learns nothing.
        "critics": [digest_of_contents(run.learner.state().values())] * (algorithm != "map_elites"),
    }


def graph(algorithm: str, task: str) -> Digests:
    """Carry out a run with the orchestrator, in a separate ROS domain, and read its files.

    Raises:
        SystemExit: The run failed.
    """
    with tempfile.TemporaryDirectory() as folder, domain_id() as domain:
        values = {**values_of(algorithm, task), "evaluators": 2, "serve": "false"}
        run_dir = Path(folder) / "run"
        command = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator", "--ros-args"]
        for name, value in {**values, "run_dir": run_dir}.items():
            command += ["-p", f"{name}:={list(value) if isinstance(value, tuple) else value}"]
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=GRAPH_TIMEOUT,
            check=False,
        )
        if done.returncode:
            raise SystemExit(
                f"The orchestrator ended with {done.returncode}:\n{done.stdout.decode()}"
            )
        return run_digests(run_dir)


def run_digests(run_dir: Path) -> Digests:
    """Digest what a run has stored."""
    with sqlite3.connect(f"file:{run_dir}/repertoire.db?mode=ro", uri=True) as connection:
        (run,) = rows(connection, "run", "id")
        elites = rows(connection, "elites", "cell")
        generations = rows(connection, "generations", "generation")
        extremes = rows(connection, "extremes", "generation")
    connection.close()
    geometry = json.dumps(json.loads(run["archive"]), sort_keys=True)
    metrics = zip(generations, extremes, strict=True)
    return {
        "archive": [digest(geometry, run["centroids"])],
        "episodes": [digest_of_contents(a) for a in stored(run_dir / "experience", "experience-")],
        "metrics": [digest(*results(a), *results(b)) for a, b in metrics],
        "elites' parameters": [digest(*(e["parameters"] for e in elites))],
        "elites' fitness": [digest(*(e["fitness"] for e in elites))],
        "elites' descriptors": [digest(*(e["descriptor"] for e in elites))],
        "elites' lineage": [digest(*(e[n] for e in elites for n in (*LINEAGE, *EPISODE)))],
        "critics": [digest_of_contents(a) for a in stored(run_dir, "critic-", "state.")],
    }


def rows(connection: sqlite3.Connection, table: str, order: str) -> list[dict[str, Any]]:
    """Return a table's rows by column."""
    cursor = connection.execute(f"SELECT * FROM {table} ORDER BY {order}")
    names = [column[0] for column in cursor.description]
    return [dict(zip(names, row, strict=True)) for row in cursor]


def results(row: Mapping[str, Any]) -> list[Any]:
    """Return the columns of a row that are part of a result."""
    values = [value for name, value in sorted(row.items()) if name not in NOT_RESULT]
    return [
        json.dumps(of_known_operators(tuple(json.loads(v)))) if isinstance(v, str) else v
        for v in values
    ]


def stored(folder: Path, start: str, prefix: str = "") -> Iterator[list[np.ndarray]]:
    """Yield, file by file, the arrays of a folder's checkpoints that have a name prefix."""
    for path in sorted(folder.glob(f"{start}*.ckpt")):
        content = path.read_bytes()
        begin = len(MAGIC) + 8
        if not content.startswith(MAGIC):
            raise SystemExit(f"'{path.name}' has another layout than this bench can read.")
        (length,) = struct.unpack("<Q", content[len(MAGIC) : begin])
        position = begin + length
        found = []
        for entry in json.loads(content[begin:position])["arrays"]:
            position = -(-position // 64) * 64  # arrays start at multiples of 64 bytes
            dtype, count = np.dtype(entry["dtype"]), int(np.prod(entry["shape"], dtype=np.int64))
            array = np.frombuffer(content, dtype, count, position).reshape(entry["shape"])
            position += array.nbytes
            if entry["name"].startswith(prefix):
                found.append(array)
        yield found


def main(tree: str, *options: str) -> None:
    """Print the digests of all runs; `options` may be 'no-graph'.

    Raises:
        SystemExit: Python imported another tree, or a run failed.
    """
    if not Path(pga_me_ros.__file__).resolve().is_relative_to(Path(tree).resolve()):
        raise SystemExit(f"Python imports {pga_me_ros.__file__}, not the tree '{tree}'.")
    out = {
        f"search {task} {algorithm}": search(algorithm, task)
        for task in TASKS
        for algorithm in ALGORITHMS
        if is_known(algorithm)
    }
    if "no-graph" not in options:
        algorithm, task = GRAPH
        out[f"graph {task} {algorithm}"] = graph(algorithm, task)
    print(json.dumps(out))


if __name__ == "__main__":
    main(*sys.argv[1:])
