"""Which file the actor of a stored run is read from, and what is said where there is none or it is damaged."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.runs.stored_actor import NoActorError, StoredActor
from pga_me_ros.core.storage.actor_file import FILE, save_actor
from pga_me_ros.core.storage.npz import load_arrays, save_arrays
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import StorageError
from pga_me_ros.tasks.registry import task_spec


@pytest.fixture
def run(dcrl_run: Path, tmp_path: Path) -> StoredRun:
    """A copy of a run with its checkpoint of critics."""
    return StoredRun.load(shutil.copytree(dcrl_run, tmp_path / "run"))


@pytest.fixture
def thinned(run: StoredRun) -> Path:
    """The same repertoire with its actor in a file of its own; the file."""
    stored = StoredActor.of(run)
    save_actor(run.file, run.info.run_id, run.spec, stored.actor, stored.generation)
    checkpoint(run).unlink()
    return run.file.with_name(FILE)


def checkpoint(run: StoredRun) -> Path:
    (file,) = run.file.parent.glob("critic-*.ckpt")
    return file


def test_its_own_file_has_the_same_actor(run: StoredRun, dcrl_run: Path, thinned: Path) -> None:
    mine, theirs = StoredActor.of(run), StoredActor.of(StoredRun.load(dcrl_run))
    assert mine.actor.parameters.tobytes() == theirs.actor.parameters.tobytes()
    assert (mine.actor.shape, mine.generation, mine.note) == (theirs.actor.shape, 3, "")
    assert thinned.stat().st_size < 10_000


def test_the_newest_checkpoint_counts_and_an_older_one_where_it_is_damaged(run: StoredRun) -> None:
    whole = checkpoint(run)
    before = StoredActor.of(run)
    damaged = whole.with_name("critic-00000009.ckpt")
    damaged.write_bytes(whole.read_bytes()[:-1])
    stored = StoredActor.of(run)
    assert stored.actor.parameters.tobytes() == before.actor.parameters.tobytes()
    assert (before.note, stored.generation) == ("", 3)
    assert "critic-00000009.ckpt is damaged" in stored.note
    assert stored.note.endswith(f"'{whole.name}' is used instead.")
    whole.unlink()
    with pytest.raises(StorageError, match=r"critic-00000009\.ckpt is damaged"):
        StoredActor.of(run)


def test_a_repertoire_alone_has_none(run: StoredRun) -> None:
    checkpoint(run).unlink()
    with pytest.raises(NoActorError, match="no training has ended yet, or the repertoire was cop"):
        StoredActor.of(run)


def test_checkpoints_of_another_robot_are_refused(run: StoredRun) -> None:
    spec = task_spec("qd_walker")
    with pytest.raises(StorageError, match="are not of its run: An actor with layers"):
        StoredActor.load(run.file, run.info.run_id, spec, run.settings)


def spoiled(file: Path, **changes: object) -> None:
    arrays = load_arrays(file, "pga_me_ros actor 1", "file of an actor")
    arrays |= {name: np.array(value) for name, value in changes.items()}
    save_arrays(file, {name: a for name, a in arrays.items() if a.shape or a.dtype != object})


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"run_id": "another"}, "is of run another, but the repertoire next to it is of run"),
        ({"format": "pga_me_ros actor 2"}, "its array 'format' is 'pga_me_ros actor 2'"),
        ({"layer_sizes": [3, 2]}, r"holds no actor of this repertoire \(.*; thin the run again"),
        ({"parameters": [0.5]}, "holds no actor of this repertoire"),
        ({"generation": None}, "holds no actor of this repertoire .'generation'."),
    ],
)
def test_a_file_that_does_not_belong_here_is_refused(
    run: StoredRun, thinned: Path, changes: dict[str, object], complaint: str
) -> None:
    spoiled(thinned, **changes)
    with pytest.raises(StorageError, match=complaint):
        StoredActor.of(run)


def test_a_file_that_was_cut_short_is_damaged(run: StoredRun, thinned: Path) -> None:
    thinned.write_bytes(thinned.read_bytes()[:-100])
    with pytest.raises(StorageError, match=r"actor\.npz' is damaged"):
        StoredActor.of(run)
