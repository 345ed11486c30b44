"""A small run's archive and file for the storage tests; also run as a script by other processes."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Elite, Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.run_info import RunInfo

HERE = Path(__file__).parent
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{HERE.parents[1]}{os.pathsep}{HERE}"}
P = 50
NOBODY = 65534
RATES = {"n_evo": 50, "discount": 0.99}
INFO = RunInfo(
    run_id="9f1c7b1e-0000-4000-8000-000000000000",
    settings=Settings().to_dict(),
    task={"name": "qd_walker", "descriptor_low": [0.0, 0.0]},
    layer_sizes=(22, 128, 6),
    activations=("relu", "tanh"),
    versions={"numpy": "2.4.6"},
    created="2026-01-01T00:00:00+00:00",
)


def empty(kind: str = "cvt") -> Archive:
    if kind == "grid":
        return GridArchive((8, 8), [0, 0], [1, 1], P)
    return CvtArchive(np.random.default_rng(0).random((64, 2)), [0, 0], [1, 1], P)


def generations(archive: Archive, count: int) -> Iterator[tuple[int, list[Elite], Metrics]]:
    """Grow an archive; yield each generation's number, changed elites and metrics."""
    before = None
    for generation in range(count):
        rng = np.random.default_rng(generation)
        parameters = rng.normal(size=(20, P))
        # Signed zeros and denormals must be read back unchanged.
        parameters[:, 0], parameters[:, 1] = -0.0, 1e-40
        batch = Solutions.of(
            fitness=rng.integers(-5, 50, 20) / 2,
            descriptors=rng.integers(0, 11, (20, 2)) / 10,
            parameters=parameters,
            evaluations=range(20 * generation, 20 * generation + 20),
            generation=generation,
            operators=rng.choice(list(Operator), 20),
            parents=rng.integers(-1, 100, (20, 2)),
            steps=rng.integers(1, 1000, 20),
            terminated=rng.random(20) < 0.5,
        )
        added = archive.add(batch)
        before = generation_metrics(archive, batch, added, generation, before)
        yield generation, [archive.elite(cell) for cell in added.changed_cells], before


def grow(repertoire: Repertoire, archive: Archive, count: int) -> None:
    for generation, elites, metrics in generations(archive, count):
        repertoire.commit(generation, elites, metrics, RATES)


def make(path: Path, count: int = 4, kind: str = "cvt") -> Archive:
    """Write a file of some generations and close it; return its archive."""
    archive = empty(kind)
    with Repertoire.create(path, INFO, archive) as repertoire:
        grow(repertoire, archive, count)
    return archive


def stay_in_a_transaction(path: Path) -> None:
    """Commit four generations, then stay in the middle of the next transaction until killed."""
    archive = empty()
    repertoire = Repertoire.create(path, INFO, archive)
    for generation, elites, metrics in generations(archive, 4):
        repertoire.commit(generation, elites, metrics, RATES)
    # A second connection of the same process simulates an unfinished commit; with so small a cache,
    # SQLite writes its pages into the log before the commit.
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA cache_size = 1")
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("UPDATE elites SET fitness = 1e9, parameters = zeroblob(200000)")
    print(repertoire.last_generation, flush=True)
    sys.stdin.read()


@contextmanager
def writer_in_a_transaction(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a process that has committed four generations and is in the middle of a transaction."""
    process = subprocess.Popen(
        [sys.executable, __file__, str(path)],
        env=ENVIRONMENT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "3\n"
        yield process
        process.kill()


def give_up_root() -> None:
    """Become an ordinary user, to whom file permissions apply; import everything first."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


if __name__ == "__main__":
    stay_in_a_transaction(Path(sys.argv[1]))
