"""Runs that start from the controllers of another: what they accept and refuse, and how they resume."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from operator_counts import per_operator

from pga_me_ros.core.archive.elites import NO_PARENT
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.runs.run_directory import RunDirectory, open_run
from pga_me_ros.core.runs.start_from import COPY, read_controllers
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.npz import (
    FORMAT,
    load_arrays,
    repertoire_arrays,
    save_arrays,
)
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.errors import SettingsError, StorageError
from pga_me_ros.tasks.registry import make_task, task_spec

SPEC = task_spec("qd_hopper")
SETTINGS = Settings(
    task="qd_hopper",
    random_init=10,
    batch_size=10,
    n_evo=10,
    cells=30,
    cvt_samples=1000,
    controller_hidden=(16, 8),
)
SHAPE = controller_shape(SPEC, SETTINGS)


@pytest.fixture(scope="module")
def elites(hopper_run: Path) -> np.ndarray:
    """Return the (n, P) controllers of the run, in the order of their cells."""
    with Repertoire.open(hopper_run / REPERTOIRE, read_only=True) as repertoire:
        archive = repertoire.load_archive()
    return archive.parameters[archive.filled]


@pytest.fixture
def exported(hopper_run: Path, tmp_path: Path) -> Path:
    """Return the run as an exported file."""
    with Repertoire.open(hopper_run / REPERTOIRE, read_only=True) as repertoire:
        info, archive = repertoire.info, repertoire.load_archive()
    path = tmp_path / "elites.npz"
    save_arrays(path, repertoire_arrays(info, archive, archive.filled_cells().tolist()))
    return path


def start(path: Path, source: object, **changes: object) -> RunDirectory:
    """Open a run directory and release it at once."""
    settings = SETTINGS.replace(start_from=str(source), **changes)
    directory = open_run(path, SPEC, settings)
    directory.lock.release()
    return directory


def test_folder_repertoire_and_export_give_the_same_controllers(
    hopper_run: Path, exported: Path, elites: np.ndarray
) -> None:
    for source in (hopper_run, hopper_run / REPERTOIRE, exported):
        assert np.array_equal(read_controllers(source, SPEC, SHAPE), elites)


def test_imported_controllers_come_first_and_random_ones_fill_the_batch(elites: np.ndarray) -> None:
    some = elites[:7]
    search = Search(SPEC, SETTINGS, some)
    batch = search.ask()
    assert np.array_equal(batch.parameters[:7], some)
    assert batch.operators.tolist() == [Operator.IMPORTED] * 7 + [Operator.RANDOM] * 3
    assert (batch.parents == NO_PARENT).all()
    # A random controller depends only on its place.
    assert np.array_equal(batch.parameters[7:], Search(SPEC, SETTINGS).ask().parameters[7:])


def test_more_controllers_than_random_init_are_all_evaluated(elites: np.ndarray) -> None:
    many = np.concatenate([elites, elites])[:23]
    search = Search(SPEC, SETTINGS, many)
    assert search.settings.init_generations == 3
    task = make_task("qd_hopper")
    got = []
    for _ in range(3):
        got.append(search.ask().parameters)
        search.run_generation(task)
    task.close()
    assert np.array_equal(np.concatenate(got)[:23], many)
    assert [m.offspring for m in search.metrics] == [
        per_operator(imported=10),
        per_operator(imported=10),
        per_operator(random=7, imported=3),
    ]
    assert set(search.ask().operators.tolist()) == {Operator.GA}


def test_an_imported_elite_has_the_fitness_that_it_gets_here(elites: np.ndarray) -> None:
    search = Search(SPEC, SETTINGS, elites[:10])
    task = make_task("qd_hopper")
    search.run_generation(task)
    task.close()
    assert {elite.operator for elite in search.archive.elites()} == {Operator.IMPORTED}
    plain = [elite.fitness for elite in search.archive.elites()]
    again = Search(SPEC, SETTINGS.replace(seed=1), elites[:10])
    task = make_task("qd_hopper")
    again.run_generation(task)
    task.close()
    assert plain != [elite.fitness for elite in again.archive.elites()]


def test_a_run_resumes_without_its_source(
    hopper_run: Path, tmp_path: Path, elites: np.ndarray
) -> None:
    source = tmp_path / "source"
    shutil.copytree(hopper_run, source)
    first = start(tmp_path / "run", source)
    assert np.array_equal(first.imported, elites)
    assert first.settings.random_init == max(10, len(elites))
    shutil.rmtree(source)
    resumed = start(tmp_path / "run", source)
    assert (resumed.run_id, resumed.settings) == (first.run_id, first.settings)
    assert np.array_equal(resumed.imported, elites)
    # The run's settings in get_info name it, too.
    assert start(tmp_path / "run", first.settings.start_from).run_id == first.run_id


def test_a_run_resumes_from_a_moved_source_with_the_same_controllers(
    hopper_run: Path, exported: Path, tmp_path: Path
) -> None:
    first = start(tmp_path / "run", hopper_run)
    assert start(tmp_path / "run", exported).run_id == first.run_id


def test_other_controllers_make_another_run(
    hopper_run: Path, new_run: Callable[..., Path], tmp_path: Path
) -> None:
    start(tmp_path / "run", hopper_run)
    other = new_run(seed=6)
    with pytest.raises(StorageError, match=r"start_from: sha256:\w+ != sha256:"):
        start(tmp_path / "run", other)
    with pytest.raises(StorageError, match="start_from: sha256:"):
        start(tmp_path / "run", "")


@pytest.fixture
def other_run(new_run: Callable[..., Path]) -> Path:
    """Return a run of another seed."""
    return new_run(seed=6)


def test_a_run_starts_from_several_one_after_the_other(
    hopper_run: Path, other_run: Path, exported: Path, tmp_path: Path, elites: np.ndarray
) -> None:
    of_other = read_controllers(other_run, SPEC, SHAPE)
    assert not np.array_equal(of_other, elites)
    both = start(tmp_path / "run", f"{hopper_run}, {other_run}")
    assert np.array_equal(both.imported, np.concatenate([elites, of_other]))
    for same in (f"{hopper_run},{other_run}", f"{exported} , {other_run / REPERTOIRE}"):
        assert start(tmp_path / "run", same).run_id == both.run_id
    # In another order, each would be evaluated from another start.
    with pytest.raises(StorageError, match=r"start_from: sha256:\w+ != sha256:"):
        start(tmp_path / "run", f"{other_run}, {hopper_run}")


def test_a_run_resumes_without_one_of_its_sources(
    hopper_run: Path, other_run: Path, tmp_path: Path
) -> None:
    source = tmp_path / "source"
    shutil.copytree(hopper_run, source)
    first = start(tmp_path / "run", f"{other_run}, {source}")
    shutil.rmtree(source)
    for given in (f"{other_run}, {source}", first.settings.start_from):
        assert start(tmp_path / "run", given).run_id == first.run_id


def test_one_of_several_sources_may_come_with_the_package(tmp_path: Path) -> None:
    shape = controller_shape(SPEC, Settings(task="qd_hopper"))
    shipped = read_controllers(Path("zoo/qd_hopper"), SPEC, shape)
    run = StoredRun.load("zoo/qd_hopper")
    best = tmp_path / "best.npz"
    save_arrays(best, repertoire_arrays(run.info, run.archive, [run.choose().cell]))
    both = start(tmp_path / "run", f"zoo/qd_hopper,{best}", controller_hidden=shape.sizes[1:-1])
    assert np.array_equal(both.imported[:-1], shipped)
    assert np.array_equal(both.imported[-1], run.choose().parameters)


def test_a_source_may_have_a_comma_in_its_name(
    hopper_run: Path, tmp_path: Path, elites: np.ndarray
) -> None:
    source = tmp_path / "walks, fast"
    shutil.copytree(hopper_run, source)
    assert np.array_equal(start(tmp_path / "run", source).imported, elites)


@pytest.mark.parametrize(
    ("second", "error", "words"),
    [
        ("", SettingsError, "has an empty entry; remove the comma"),
        (",{run}", SettingsError, "has an empty entry; remove the comma"),
        ("{run}/repertoire.db", SettingsError, "names the same controllers twice: .*; leave one"),
        ("~nobody_here/run", SettingsError, "start_from: '~nobody_here/run' begins with"),
        ("lost", StorageError, "There is no repertoire 'lost'"),
        ("zoo/qd_walker", StorageError, "are of task 'qd_walker', but this run's task is"),
        ("zoo/qd_hoper", StorageError, r"no repertoire 'zoo/qd_hoper' \(did you mean 'zoo/qd_hop"),
    ],
)
def test_each_of_several_sources_is_checked(
    hopper_run: Path, tmp_path: Path, second: str, error: type[Exception], words: str
) -> None:
    text = f"{hopper_run}, {second.format(run=hopper_run)}"
    with pytest.raises(error, match=words):
        start(tmp_path / "run", text)
    assert not (tmp_path / "run" / REPERTOIRE).exists()


def test_a_damaged_copy_is_refused(hopper_run: Path, tmp_path: Path) -> None:
    start(tmp_path / "run", hopper_run)
    copy = tmp_path / "run" / COPY
    content = bytearray(copy.read_bytes())
    content[len(content) // 2] ^= 1
    copy.write_bytes(bytes(content))
    with pytest.raises(StorageError, match=r"start_from\.npz' is damaged"):
        start(tmp_path / "run", hopper_run)


def test_leftovers_of_an_interrupted_start_do_no_harm(
    hopper_run: Path, tmp_path: Path, elites: np.ndarray
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / COPY).write_bytes(b"half a fi")
    assert np.array_equal(start(tmp_path / "run", hopper_run).imported, elites)


def harm(name: str, value: object) -> Callable[[Path], None]:
    def change(file: Path) -> None:
        arrays = load_arrays(file, FORMAT, "export")
        if value is None:
            del arrays[name]
        else:
            arrays[name] = np.asarray(value(arrays[name]) if callable(value) else value)
        save_arrays(file, arrays)

    return change


def truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-50])


def write_text(file: Path) -> None:
    file.write_text("cell,fitness\n1,2.0\n")


def write_object(file: Path) -> None:
    np.savez(file, format=np.array(FORMAT), parameters=np.array([object()]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (Path.unlink, "There is no repertoire"),
        (truncate, "is damaged or no exported repertoire"),
        (write_text, "is not a repertoire file"),
        (write_object, "is damaged or no exported repertoire"),
        (harm("format", "another"), "its array 'format' is 'another'"),
        (harm("parameters", None), "lacks the arrays parameters"),
        (harm("task", "qd_walker"), "are of task 'qd_walker', but this run's task is 'qd_hopper'"),
        (harm("layer_sizes", [15, 8, 3]), r"have layers \[15, 8, 3\].*controller_hidden:=\[8\]"),
        (harm("action_names", ["a", "b", "c"]), "other action names"),
        (harm("parameters", lambda p: p[:, 1:]), r"expected float32 of \(controllers,"),
        (harm("parameters", lambda p: p.astype(float)), "the parameters are float64"),
        (harm("parameters", lambda p: p[:0]), "holds no behavior yet"),
        (harm("parameters", lambda p: p * np.float32(np.nan)), "not finite"),
    ],
)
def test_an_invalid_source_is_refused_with_a_reason(
    exported: Path, tmp_path: Path, change: Callable[[Path], None], words: str
) -> None:
    change(exported)
    with pytest.raises(StorageError, match=words):
        start(tmp_path / "run", exported)
    assert not (tmp_path / "run" / REPERTOIRE).exists()


def test_an_older_version_of_the_task_is_refused(hopper_run: Path) -> None:
    renamed = dataclasses.replace(SPEC, observation_units=("m",) * SPEC.observation_dim)
    with pytest.raises(StorageError, match="other observation units"):
        read_controllers(hopper_run, renamed, SHAPE)
