"""Damage to a repertoire file is reported or without effect, but never served as good."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import StorageError
from repertoires import empty, generations, make, writer_in_a_transaction


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "repertoire.db"


def _contents(path: Path) -> tuple:
    with Repertoire.open(path, read_only=True) as repertoire:
        archive, metrics = repertoire.load_archive(), repertoire.metrics()
        bests = [best.to_bytes() for best in repertoire.bests()]
        return archive.digest(), metrics, repertoire.rates(), repertoire.info, bests


def test_a_flipped_bit_is_detected_or_harmless(path: Path) -> None:
    make(path)
    intact, original = _contents(path), path.read_bytes()
    detected = 0
    for position in np.random.default_rng(0).integers(0, 8 * len(original), 400).tolist():
        damaged = bytearray(original)
        damaged[position // 8] ^= 1 << position % 8
        path.write_bytes(damaged)
        try:
            assert _contents(path) == intact, f"bit {position} was served as good"
        except StorageError:
            detected += 1
    assert detected > 50


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.6, 0.99])
def test_a_truncated_file_is_detected(path: Path, share: float) -> None:
    make(path)
    os.truncate(path, int(share * path.stat().st_size))
    with pytest.raises(StorageError, match="damaged"):
        _contents(path)


@pytest.mark.parametrize(
    "damage",
    [
        "DELETE FROM elites WHERE cell = (SELECT max(cell) FROM elites)",
        "UPDATE elites SET fitness = fitness + 1 WHERE cell = (SELECT max(cell) FROM elites)",
        "UPDATE elites SET cell = 63 - cell + 1000",
        "UPDATE elites SET operator = 'pg'",
        "DELETE FROM generations WHERE generation = 3",
        "DELETE FROM generations WHERE generation = 1",
        "UPDATE generations SET qd_score = 1e9 WHERE generation = 1",
        "UPDATE run SET centroids = zeroblob(length(centroids))",
        "UPDATE run SET info = replace(info, 'relu', 'tanh')",
        "DELETE FROM run",
        "DROP TABLE generations",
        "UPDATE extremes SET min_fitness = -1e9 WHERE generation = 1",
        "UPDATE extremes SET best_evaluation = 0 WHERE generation = 3",
        "DELETE FROM extremes WHERE generation = 2",
        "UPDATE bests SET fitness = fitness + 1",
        "DELETE FROM bests WHERE evaluation = (SELECT max(evaluation) FROM bests)",
        "ALTER TABLE elites RENAME COLUMN digest TO checksum",
    ],
)
def test_contents_that_were_not_committed_are_detected(path: Path, damage: str) -> None:
    make(path)
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(damage)
    with pytest.raises(StorageError, match="damaged"):
        _contents(path)


def test_elites_of_an_older_generation_are_detected(path: Path, tmp_path: Path) -> None:
    make(path, 4)
    make(tmp_path / "old.db", 1)
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("ATTACH ? AS old", (str(tmp_path / "old.db"),))
        connection.execute("INSERT OR REPLACE INTO elites SELECT * FROM old.elites")
    with pytest.raises(StorageError, match="not those of its last generation"):
        _contents(path)


def store_experience(folder: Path, newest: int) -> None:
    (folder / "experience").mkdir()
    for generation in range(newest + 1):
        (folder / "experience" / f"experience-{generation:08d}.ckpt").touch()


@pytest.mark.parametrize("read_only", [True, False])
def test_a_file_that_ends_before_its_run_is_reported(path: Path, read_only: bool) -> None:
    make(path, 4)
    store_experience(path.parent, 5)
    with pytest.raises(
        StorageError, match=r"ends with generation 3, but .* generation 5: what was"
    ):
        Repertoire.open(path, read_only)


def test_experience_of_the_current_generation_is_no_loss(path: Path) -> None:
    make(path, 4)
    store_experience(path.parent, 4)
    assert Repertoire.open(path, read_only=True).last_generation == 3


def wal_frame(path: Path, number: int) -> int:
    """Return the position of a frame in the log."""
    return 32 + number * (24 + int.from_bytes(path.read_bytes()[8:12]))


def commit_frame(path: Path, generation: int) -> int:
    """Return the number of the frame that ends a generation's commit, which holds the size of the database."""
    content = path.read_bytes()
    frames = (len(content) - 32) // (24 + int.from_bytes(content[8:12]))
    starts = [wal_frame(path, number) for number in range(frames)]
    return [n for n, at in enumerate(starts) if int.from_bytes(content[at + 4 : at + 8])][
        generation
    ]


@pytest.mark.parametrize(
    ("frame", "lost"),
    [
        (-1, True),
        (0, True),
        ("commit 2", True),
        ("commit 3", False),
        (20, False),
        ("cut", True),
        ("gone", True),
    ],
)
def test_a_damaged_log_loses_no_generation_unnoticed(
    path: Path, frame: int | str, lost: bool
) -> None:
    """Four generations are in the log of a killed writer; a reader gets all but one of them, or an error."""
    log = Path(f"{path}-wal")
    with writer_in_a_transaction(path):
        pass
    Path(f"{path}-shm").unlink()
    if frame == "gone":
        log.unlink()
    elif frame == "cut":
        os.truncate(log, wal_frame(log, 2))
    else:
        content = bytearray(log.read_bytes())
        if isinstance(frame, str):
            frame = commit_frame(log, int(frame.removeprefix("commit ")))
        content[24 if frame == -1 else wal_frame(log, int(frame)) + 100] ^= 1
        log.write_bytes(content)
    store_experience(path.parent, 3)
    archive = empty()
    digests = [archive.digest() for _ in generations(archive, 4)]
    with pytest.raises(StorageError, match="is lost") if lost else contextlib.nullcontext():
        assert _contents(path)[0] in digests[2:]
