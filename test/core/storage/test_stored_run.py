"""Reading a run from its folder, and choosing one of its behaviors."""

from __future__ import annotations

import dataclasses
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.metrics import generation_metrics
from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.storage import repertoire
from pga_me_ros.core.storage.npz import save_arrays
from pga_me_ros.core.storage.reading import read_archive
from pga_me_ros.core.storage.reevaluations import Reevaluations
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.errors import ArchiveError, PgaError, RequestError, StorageError
from pga_me_ros.tasks.registry import make_task, task_spec
from pga_me_ros.tasks.rollout import rollout


@pytest.fixture(scope="module")
def run(hopper_run: Path) -> StoredRun:
    return StoredRun.load(hopper_run)


@pytest.fixture(scope="module")
def judged(hopper_run: Path, tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    """Return the run after its two fittest elites were re-evaluated: the better one was lucky."""
    folder = tmp_path_factory.mktemp("judged") / "run"
    shutil.copytree(hopper_run, folder)
    run = StoredRun.load(folder)
    cells = run.archive.filled_cells()
    best = cells[np.argsort(-run.archive.fitness[cells])][:2]
    Reevaluations(
        run_id=run.info.run_id,
        evaluation=run.archive.evaluations[best],
        repeat=np.zeros(2, np.int64),
        fitness=np.array([1.0, 2.0]),
        descriptor=np.array([[0.25], [0.75]]),
        steps=np.ones(2, np.int64),
        terminated=np.ones(2, np.bool_),
    ).save(folder / REPERTOIRE)
    return StoredRun.load(folder)


def test_folder_and_file_give_the_same_run(hopper_run: Path, run: StoredRun) -> None:
    other = StoredRun.load(str(hopper_run / REPERTOIRE))
    assert other.archive.digest() == run.archive.digest()
    assert (other.name, other.info, other.metrics) == (hopper_run.name, run.info, run.metrics)
    assert (run.settings.seed, run.spec.name, run.shape.sizes[1:3]) == (5, "qd_hopper", (16, 8))
    assert run.curve("evaluations").tolist() == [10.0, 20.0]


def test_generations_and_archive_are_of_one_state_of_a_growing_run(
    hopper_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(hopper_run, folder)
    before = StoredRun.load(folder)
    archive, last = StoredRun.load(folder).archive, before.generations[-1]
    cell = int(archive.filled_cells()[0])
    better = archive.elite(cell)
    batch = Solutions.of(
        fitness=[better.fitness + 1.0],
        descriptors=better.descriptor[None],
        parameters=better.parameters[None],
        evaluations=[20],
        generation=2,
    )
    added = archive.add(batch)
    metrics = generation_metrics(archive, batch, added, 2, last.metrics)

    def after_a_commit(*file: Any) -> Archive:
        monkeypatch.undo()
        with Repertoire.open(folder / REPERTOIRE) as growing:
            growing.commit(2, [archive.elite(cell)], metrics, last.rates)
        return read_archive(*file)

    monkeypatch.setattr(repertoire, "read_archive", after_a_commit)
    torn = StoredRun.load(folder)
    assert len(torn.generations) == 2
    assert torn.archive.digest() == before.archive.digest()
    now = StoredRun.load(folder)
    assert len(now.generations) == 3
    assert now.archive.digest() == archive.digest()


def test_the_archive_can_be_read_on_first_use(hopper_run: Path, run: StoredRun) -> None:
    light = StoredRun.load(hopper_run, elites=False)
    assert "archive" not in vars(light)
    assert light.archive.digest() == run.archive.digest()
    assert [best.evaluation for best in light.bests()] == list(
        dict.fromkeys(m.best_evaluation for m in run.metrics)
    )


def test_a_chosen_behavior_does_what_its_evaluation_did(run: StoredRun) -> None:
    behavior = run.choose()
    task = make_task("qd_hopper")
    act = as_evaluated(run.settings, behavior.controller, behavior.evaluation)
    episode = rollout(task, act, evaluation_rng(run.settings.seed, behavior.evaluation))
    task.close()
    assert (episode.fitness, episode.length) == (behavior.fitness, behavior.steps)
    assert np.array_equal(episode.descriptor, behavior.descriptor)
    elite = run.archive.best()
    assert behavior.fitness == run.metrics[-1].max_fitness == elite.fitness
    assert (behavior.made_by, behavior.generation) == (elite.operator.label, elite.generation)
    assert np.array_equal(behavior.parameters, elite.parameters)


def test_each_way_to_choose_gives_its_behavior(run: StoredRun) -> None:
    for elite in run.archive.elites():
        assert run.choose(cell=elite.cell).evaluation == elite.evaluation
        near = run.choose(descriptor=elite.descriptor + 1e-9)
        assert near.cell == elite.cell
        assert near.distance == pytest.approx(1e-9, abs=1e-12)
    assert run.choose(best=True).cell == run.archive.best().cell
    median = float(np.median(run.archive.fitness[run.archive.filled]))
    chosen = {run.choose(random=True, min_fitness=median).cell for _ in range(200)}
    fit = run.archive.filled_cells()[
        run.archive.fitness[run.archive.filled_cells()] >= median
    ].tolist()
    assert chosen == set(fit)


def test_behaviors_are_judged_by_means_on_request(judged: StoredRun) -> None:
    lucky, steady = judged.statistics.repeats.nonzero()[0][
        np.argsort(judged.statistics.mean_fitness[judged.statistics.repeats > 0])
    ]
    assert judged.choose(single=True).cell == lucky
    assert judged.choose(by_mean=True).cell == steady
    # Where there are no means, the single evaluation counts: both have become worse than a third one.
    default = judged.choose()
    assert default.cell not in (lucky, steady)
    assert (default.by_mean, default.promised_fitness) == (False, default.fitness)
    found = judged.choose(cell=int(lucky))
    assert (found.by_mean, found.promised_fitness, found.promised_descriptor) == (True, 1.0, 0.25)
    assert judged.choose(cell=int(lucky), single=True).promised_fitness == found.fitness > 1.0
    assert judged.choose(by_mean=True, descriptor=[0.7]).cell == steady
    assert {judged.choose(by_mean=True, random=True).cell for _ in range(50)} == {lucky, steady}
    other = next(c for c in judged.archive.filled_cells() if c not in (lucky, steady))
    with pytest.raises(PgaError, match=f"The behavior of cell {other} was not re-evaluated"):
        judged.choose(by_mean=True, cell=int(other))


@pytest.mark.parametrize(
    ("choice", "error", "words"),
    [
        ({"best": True, "cell": 3}, RequestError, "in one way: .*; given: cell, best"),
        ({"max_distance": 0.1}, RequestError, "give it together with a descriptor"),
        ({"descriptor": [0.1, 0.2]}, RequestError, "has 2 entries; this repertoire's has 1"),
        ({"descriptor": [float("nan")]}, RequestError, "descriptor is or holds nan; give a number"),
        ({"descriptor": [9.0], "max_distance": 0.1}, RequestError, "No behavior lies within 0.1"),
        ({"min_fitness": 1e6}, RequestError, "No behavior has a fitness of 1000000.0 or more; the"),
        (
            {"min_fitness": 1e6, "random": True},
            RequestError,
            "No behavior has a fitness of 1000000",
        ),
        ({"min_fitness": 1e6, "cell": -2}, ArchiveError, "Cell -2 does not exist"),
        ({"cell": 30}, ArchiveError, "Cell 30 does not exist; give one from 0 to 29"),
        ({"by_mean": True}, RequestError, "No behavior of this repertoire was re-evaluated"),
        ({"by_mean": True, "single": True}, RequestError, "by_mean and single contradict"),
        ({"max_fall_share": -0.5}, RequestError, "max_fall_share is -0.5; give a share"),
        ({"max_fall_share": 0.5}, RequestError, "at most 50 % of its evaluations; none was re"),
    ],
)
def test_impossible_choices_are_refused(
    run: StoredRun, choice: dict[str, object], error: type[PgaError], words: str
) -> None:
    with pytest.raises(error, match=words):
        run.choose(**choice)


def test_an_empty_cell_is_refused(run: StoredRun) -> None:
    empty = int(np.flatnonzero(~run.archive.filled)[0])
    with pytest.raises(RequestError, match=f"Cell {empty} is empty; choose a filled one"):
        run.choose(cell=empty)


def test_arrays_have_a_row_per_elite_and_means_if_there_are_any(
    run: StoredRun, judged: StoredRun
) -> None:
    arrays = run.arrays()
    assert arrays["cell"].tolist() == run.archive.filled_cells().tolist()
    assert np.array_equal(arrays["parameters"], run.archive.parameters[run.archive.filled])
    assert "mean_fitness" not in arrays
    best = judged.choose(single=True).cell
    assert judged.arrays([best])["mean_fitness"].tolist() == [1.0]
    assert judged.arrays([best])["fall_share"].tolist() == [1.0]


def test_paths_without_a_run_are_refused(hopper_run: Path, run: StoredRun, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"There is no repertoire .*repertoire\.db"):
        StoredRun.load(tmp_path)
    exported = tmp_path / "run.npz"
    save_arrays(exported, run.arrays())
    with pytest.raises(StorageError, match="is an exported file; give the folder of the run"):
        StoredRun.load(exported)


def test_a_run_without_generations_has_no_behavior(run: StoredRun, tmp_path: Path) -> None:
    directory = open_run(tmp_path / "new", task_spec("qd_hopper"), run.settings)
    directory.lock.release()
    with pytest.raises(StorageError, match="holds no behavior yet; run it for longer first"):
        StoredRun.load(directory.path)
    assert StoredRun.load(directory.path, elites=False).metrics == []


def test_damage_is_found_when_the_run_is_read(hopper_run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(hopper_run, folder)
    with sqlite3.connect(folder / REPERTOIRE) as connection:
        connection.execute(
            "UPDATE elites SET fitness = fitness + 1 WHERE rowid IN (SELECT cell FROM elites LIMIT 1)"
        )
    with pytest.raises(StorageError, match="is damaged"):
        StoredRun.load(folder)


def test_settings_of_another_version_are_refused(run: StoredRun, tmp_path: Path) -> None:
    info = dataclasses.replace(run.info, settings={**run.info.settings, "no_such": 1})
    Repertoire.create(tmp_path / REPERTOIRE, info, run.archive).close()
    with pytest.raises(StorageError, match=r"cannot be read \(.*no_such.*Use the pga_me_ros that"):
        StoredRun.load(tmp_path, elites=False)
