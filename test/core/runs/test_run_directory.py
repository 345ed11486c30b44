"""The folder of a run is resumed with the settings that made it, refused to others, and never damaged."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.runs.run_directory import RunDirectory, default_run_dir, open_run
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.settings.rules import of_other_archives
from pga_me_ros.core.storage.file_lock import LockedError
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import PgaError, SettingsError, StorageError
from pga_me_ros.tasks.registry import task_spec

TINY = Settings(
    cells=16, cvt_samples=500, controller_hidden=(4,), random_init=2, batch_size=2, n_evo=1
)


def start(path: Path, settings: Settings = TINY) -> RunDirectory:
    """Open a run directory and release it at once."""
    directory = open_run(path, task_spec(settings.task), settings)
    directory.lock.release()
    return directory


def commit(directory: RunDirectory, **rates: Any) -> None:
    """Add a generation without elites that was made with some rates."""
    with Repertoire.open(directory.repertoire) as repertoire:
        t = repertoire.last_generation + 1
        metrics = Metrics(
            generation=t,
            evaluations=2 * (t + 1),
            coverage=0,
            coverage_share=0.0,
            qd_score=0.0,
            max_fitness=0.0,
            mean_fitness=0.0,
            steps=2,
            total_steps=2 * (t + 1),
            offspring=(2, 0, 0, 0),
            new_elites=(0, 0, 0, 0),
            improved_elites=(0, 0, 0, 0),
        )
        in_force = {name: getattr(TINY, name) for name in RATES} | rates
        repertoire.commit(t, [], metrics, in_force)


def content(folder: Path) -> dict[str, str]:
    """Return a digest of every file except locks and SQLite's files for an open database."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix not in (".lock", ".db-shm", ".db-wal")
    }


def test_a_new_run_begins_with_generation_0(tmp_path: Path) -> None:
    assert start(tmp_path / "deep" / "run").next_generation == 0


def test_a_run_resumes_after_its_last_generation(tmp_path: Path) -> None:
    first = start(tmp_path)
    commit(first)
    again = start(tmp_path)
    assert (again.run_id, again.next_generation) == (first.run_id, 1)


def test_rates_that_were_set_during_the_run_stay_in_force(tmp_path: Path) -> None:
    commit(start(tmp_path), n_crit=7)
    directory = start(tmp_path)
    assert (directory.settings.n_crit, len(directory.notes)) == (7, 1)


def test_rates_given_at_a_later_start_come_into_force(tmp_path: Path) -> None:
    commit(start(tmp_path), n_crit=7)
    directory = start(tmp_path, TINY.replace(n_crit=9))
    assert (directory.before.n_crit, directory.settings.n_crit) == (7, 9)


def test_the_cells_of_the_task_are_the_same_by_number_and_by_default(tmp_path: Path) -> None:
    hopper = TINY.replace(task="qd_hopper", cells=0, cvt_samples=1000)
    first = start(tmp_path, hopper)
    assert start(tmp_path, hopper.replace(cells=1000)).run_id == first.run_id


def test_a_grid_has_the_cells_of_its_task(tmp_path: Path) -> None:
    without = {
        name: value for name, value in TINY.given.items() if name not in of_other_archives("grid")
    }
    hopper = Settings.from_mapping({**without, "task": "qd_hopper", "archive": "grid"})
    first = start(tmp_path, hopper)
    assert start(tmp_path, hopper).run_id == first.run_id
    with pytest.raises(SettingsError, match="a grid archive doesn't use it; remove cells"):
        start(tmp_path, hopper.replace(cells=8))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"task": "qd_ant"}, r"task: qd_walker != qd_ant\. Start it with its own"),
        ({"seed": 3}, r"seed: 0 != 3\. Start it"),
        ({"cells": 17, "terminal": "bootstrap"}, "cells: 16 != 17; terminal: mask != bootstrap"),
    ],
)
def test_another_run_is_refused_and_nothing_is_changed(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    commit(start(tmp_path))
    before = content(tmp_path)
    with pytest.raises(StorageError, match=words):
        start(tmp_path, TINY.replace(**changes))
    assert content(tmp_path) == before


def test_a_run_from_before_state_descriptors_resumes(tmp_path: Path) -> None:
    spec = task_spec(TINY.task)
    directory = start(tmp_path)
    with Repertoire.open(directory.repertoire, read_only=True) as repertoire:
        info = repertoire.info
    added = {"step_descriptor_names", "step_descriptor_delay"}
    old = {name: value for name, value in info.task.items() if name not in added}
    dataclasses.replace(info, task=old).require(TINY, spec.to_json())
    changed = dataclasses.replace(spec, step_descriptor_delay=0)
    with pytest.raises(StorageError, match="step_descriptor_delay of the task's spec has changed"):
        info.require(TINY, changed.to_json())


def test_a_damaged_repertoire_is_refused_and_nothing_is_changed(tmp_path: Path) -> None:
    path = start(tmp_path).repertoire
    path.write_bytes(path.read_bytes()[:20000])
    before = content(tmp_path)
    with pytest.raises(StorageError, match="damaged"):
        start(tmp_path)
    assert content(tmp_path) == before


@pytest.mark.parametrize("left", ["critic-00000005.ckpt", "experience/experience-00000003.ckpt"])
def test_leftovers_of_a_run_without_its_repertoire_are_refused(tmp_path: Path, left: str) -> None:
    (tmp_path / left).parent.mkdir(exist_ok=True)
    (tmp_path / left).touch()
    with pytest.raises(StorageError, match=f"holds '{left}' of a run whose repertoire.db is miss"):
        start(tmp_path)
    assert not (tmp_path / "repertoire.db").exists()


def test_a_directory_in_use_is_refused_with_the_process_that_uses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pga_me_ros.core.runs.run_directory.LEAVE_WAIT", 0.0)
    held = open_run(tmp_path, task_spec(TINY.task), TINY)
    with pytest.raises(
        LockedError, match=rf"another process \(pid {os.getpid()} on [^;:]*\)\. Stop that"
    ):
        start(tmp_path)
    held.lock.release()


@pytest.mark.parametrize("name", ["", "logs", "parameters", "experience"])
def test_a_file_where_a_folder_should_be_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / "run" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("in the way")
    with pytest.raises(
        StorageError, match=f"{path}' .*File exists.*choose another one, in a folder"
    ):
        start(tmp_path / "run")


@pytest.mark.parametrize("path", ["/proc/run", "/proc/1/run", "/dev/null/run"])
def test_a_folder_that_cannot_be_made_is_named(path: str) -> None:
    with pytest.raises(PgaError, match=f"'{path}'.*choose another one, in a folder that can be"):
        start(Path(path))


@pytest.mark.parametrize(
    ("task", "folder"), [("qd_ant", "qd_ant-seed7"), ("my_robots.legs:Crab", "Crab-seed7")]
)
def test_the_default_folder_is_named_after_task_and_seed(task: str, folder: str) -> None:
    assert default_run_dir(Settings(task=task, seed=7)) == Path("runs") / folder


def test_other_algorithms_have_a_default_folder_each_but_for_runs_that_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    successor = TINY.replace(algorithm="map_elites", n_evo=2)
    plain, own = Path("runs/qd_walker-seed0"), Path("runs/qd_walker-map_elites-seed0")
    assert default_run_dir(successor) == own
    start(plain)
    assert default_run_dir(successor) == own, "the other folder holds another algorithm's run"
    shutil.rmtree(plain)
    start(plain, successor)
    assert default_run_dir(successor) == plain, "an earlier version put it there"
    start(own, successor)
    assert default_run_dir(successor) == own
    assert default_run_dir(TINY) == plain
