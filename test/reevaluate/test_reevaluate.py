"""Re-evaluations of a stored run: their content, their durability, and adding more."""

from __future__ import annotations

import dataclasses
import os
import select
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.evaluation import reevaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.npz import load_arrays, save_arrays
from pga_me_ros.core.storage.reevaluations import (
    FILE,
    FORMAT,
    Reevaluations,
    fitness_differences,
)
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.reevaluate.__main__ import reevaluate
from pga_me_ros.tasks.registry import make_task, task_spec
from pga_me_ros.tasks.rollout import rollout


@pytest.fixture(scope="module")
def run(hopper_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run whose elites were all re-evaluated three times."""
    copied = Path(shutil.copytree(hopper_run, tmp_path_factory.mktemp("again") / "run"))
    print(reevaluate(copied, 3, processes=2))
    return copied


@pytest.fixture
def fresh(hopper_run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(hopper_run, tmp_path / "run"))


def load(run: Path) -> tuple[Archive, Reevaluations]:
    with Repertoire.open(run / REPERTOIRE, read_only=True) as repertoire:
        archive = repertoire.load_archive()
        rows = Reevaluations.load(run / REPERTOIRE, repertoire.info.run_id, archive.dimensions)
    return archive, rows


def test_each_row_is_the_controllers_result_from_the_pose_of_its_repeat(run: Path) -> None:
    archive, rows = load(run)
    elites = set(rows.evaluation.tolist())
    pairs = set(zip(rows.evaluation.tolist(), rows.repeat.tolist(), strict=True))
    assert pairs == {(elite, repeat) for elite in elites for repeat in range(3)}
    assert len(elites) == archive.coverage
    assert_rows_hold(run, rows, range(len(rows.fitness)))
    of_one = rows.fitness[rows.evaluation == rows.evaluation[0]]
    assert len(set(of_one.tolist())) == 3, "the poses do not differ"


def test_statistics_match_the_rows(run: Path) -> None:
    archive, rows = load(run)
    known = rows.statistics(archive)
    for cell in archive.filled_cells().tolist():
        mine = rows.evaluation == archive.evaluations[cell]
        assert known.repeats[cell] == 3
        assert known.mean_fitness[cell] == pytest.approx(rows.fitness[mine].mean(), rel=1e-12)
        spread = rows.descriptor[mine].std(axis=0, ddof=1)
        np.testing.assert_allclose(known.descriptor_spread[cell], spread, rtol=1e-12)
    empty = ~archive.filled
    assert not known.repeats[empty].any()
    assert np.isnan(known.mean_fitness[empty]).all()


def test_more_repeats_are_added_to_existing_ones(run: Path, fresh: Path) -> None:
    shutil.copy(run / FILE, fresh)
    content = (fresh / REPERTOIRE).read_bytes()
    reevaluate(fresh, 5, best=2, processes=1)
    before, after = load(run)[1], load(fresh)[1]
    assert len(after.fitness) == len(before.fitness) + 2 * 2
    assert after.fitness[: len(before.fitness)].tobytes() == before.fitness.tobytes()
    assert (fresh / REPERTOIRE).read_bytes() == content, "the repertoire was changed"


def test_nothing_is_done_twice(run: Path) -> None:
    content = (run / FILE).read_bytes()
    said = reevaluate(run, 2)
    assert (run / FILE).read_bytes() == content
    assert "3 times or more" in said


def test_a_world_has_one_file_however_it_is_written(
    fresh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pga_me_ros.reevaluate.__main__.canonical", str)  # as earlier versions
    reevaluate(fresh, 1, best=1, processes=1, randomization="friction 0.30 0.60")
    (old,) = fresh.glob("reevaluations-*.npz")
    monkeypatch.undo()
    reevaluate(fresh, 2, best=1, processes=1, randomization="friction 0.3 0.6")
    reevaluate(fresh, 1, best=1, processes=1, randomization="push 3,mass 0.90 1.1")
    reevaluate(fresh, 1, best=1, processes=1, randomization=" mass 0.9 1.1, push 3 3.0")
    worlds = {rows.elsewhere: len(rows.fitness) for rows in StoredRun.load(fresh).elsewhere}
    assert worlds == {"friction 0.30 0.60": 2, "mass 0.9 1.1, push 3": 1}
    assert old in fresh.iterdir()


def test_one_re_evaluation_tells_no_spread(fresh: Path) -> None:
    said = reevaluate(fresh, 1, best=2, processes=1)
    assert "nan" not in said
    assert "to the next): unknown, since some were re-evaluated only once" in said
    assert "(spread unknown, found with" in said


def test_the_best_of_every_generation_is_re_evaluated(new_run: Callable[..., Path]) -> None:
    run = new_run(evaluations=60, seed=6)
    with Repertoire.open(run / REPERTOIRE, read_only=True) as repertoire:
        metrics, bests = repertoire.metrics(), repertoire.bests()
        info = repertoire.info
    said = reevaluate(run, 2, processes=1, bests=True)
    _, rows = load(run)
    assert set(rows.evaluation.tolist()) == {m.best_evaluation for m in metrics}
    task, shape = make_task("qd_hopper"), MlpShape(info.layer_sizes)
    expected = []
    for m in metrics:
        (best,) = (b for b in bests if b.evaluation == m.best_evaluation)
        controller = MlpController(shape, best.parameters)
        again = [rollout(task, controller, reevaluation_rng(6, i)).fitness for i in range(2)]
        assert best.fitness == m.max_fitness
        expected.append(m.max_fitness - sum(again) / 2)
    task.close()
    assert fitness_differences(metrics, rows, 2).tolist() == expected
    assert f"(difference {expected[-1]:.1f})" in said
    # Values with fewer repeats than requested are unknown.
    assert np.isnan(fitness_differences(metrics, rows, 3)).all()


def test_progress_is_shown_where_there_is_no_terminal(
    fresh: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pga_me_ros.reevaluate.__main__.LINE_PERIOD", 0.0)
    reevaluate(fresh, 20, best=1, processes=1)
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if "note:" not in line] == [
        "0 of 20 evaluations",
        "10 of 20 evaluations",
        "20 of 20 evaluations",
    ]


@contextmanager
def started(run: Path) -> Iterator[subprocess.Popen[str]]:
    """Start a very large number of re-evaluations, and wait until the first ones are stored."""
    command = [sys.executable, "-m", "pga_me_ros.reevaluate", str(run), "--repeats", "10000"]
    command += ["--processes", "1"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Background jobs of a shell ignore Ctrl-C; so do tests among them, and this process would inherit that.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    try:
        while not (run / FILE).exists():
            assert process.poll() is None, process.stderr.read() if process.stderr else ""
            threading.Event().wait(0.02)
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def assert_rows_hold(run: Path, rows: Reevaluations, places: Iterable[int]) -> None:
    """Make sure that rows match simulations of their controllers in this process."""
    with Repertoire.open(run / REPERTOIRE, read_only=True) as repertoire:
        archive, info = repertoire.load_archive(), repertoire.info
    task = make_task("qd_hopper")
    for row in places:
        (cell,) = np.flatnonzero(archive.evaluations == rows.evaluation[row])
        controller = MlpController(MlpShape(info.layer_sizes), archive.parameters[cell])
        rng = reevaluation_rng(info.settings["seed"], int(rows.repeat[row]))
        episode = rollout(task, controller, rng)
        assert (rows.fitness[row], rows.steps[row]) == (episode.fitness, episode.length)
        assert rows.descriptor[row].tobytes() == episode.descriptor.tobytes()
    task.close()


def test_ctrl_c_keeps_what_was_done(fresh: Path) -> None:
    with started(fresh) as process:
        os.killpg(process.pid, signal.SIGINT)
        output, errors = process.communicate()
    assert (process.returncode, output) == (130, "")
    *progress, last = errors.splitlines()
    assert last == "stopped; the same command continues from here"
    assert progress
    assert all(line.endswith(" evaluations") for line in progress)
    rows = load(fresh)[1]
    assert_rows_hold(fresh, rows, range(0, len(rows.fitness), 10))


def test_workers_end_when_their_parent_is_killed(fresh: Path) -> None:
    with started(fresh) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        worker = os.pidfd_open(int(children[-1]))
        process.kill()
        assert select.select([worker], [], [], 60.0)[0], "it is still there"
        os.close(worker)


def test_a_killed_worker_is_reported_in_one_line_and_nothing_is_lost(fresh: Path) -> None:
    with started(fresh) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        # The first child is multiprocessing's resource tracker.
        os.kill(int(children[-1]), signal.SIGKILL)
        _, errors = process.communicate()
    assert process.returncode == 2
    *progress, last = errors.splitlines()
    assert last.startswith("error: A worker process was killed")
    assert all(line.endswith(" evaluations") for line in progress)
    rows = load(fresh)[1]
    assert_rows_hold(fresh, rows, range(0, len(rows.fitness), 10))


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-100])


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(bytes(content))


def rename_run(file: Path) -> None:
    arrays = load_arrays(file, FORMAT, "file")
    save_arrays(file, arrays | {"run_id": np.array("another")})


def shorten(file: Path) -> None:
    arrays = load_arrays(file, FORMAT, "file")
    save_arrays(file, arrays | {"fitness": arrays["fitness"][1:]})


def make_nan(file: Path) -> None:
    arrays = load_arrays(file, FORMAT, "file")
    save_arrays(file, arrays | {"fitness": arrays["fitness"] * np.nan})


def leave_out(file: Path) -> None:
    arrays = load_arrays(file, FORMAT, "file")
    del arrays["repeat"]
    save_arrays(file, arrays)


def replace_by_array(file: Path) -> None:
    with file.open("wb") as content:
        np.save(content, np.zeros(3))


def replace_by_text(file: Path) -> None:
    file.write_text("fitness\n1.0\n")


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (cut, "damaged or no file of re-evaluations"),
        (flip, "damaged"),
        (replace_by_text, r"damaged or no file of re-evaluations; restore it or write it again\.$"),
        (replace_by_array, "damaged or no file of re-evaluations"),
        (rename_run, "is of run another"),
        (shorten, "array 'fitness' is float64 of the shape"),
        (make_nan, "not finite"),
        (leave_out, "lacks the array 'repeat'"),
    ],
)
def test_an_invalid_file_is_refused(
    run: Path, fresh: Path, harm: Callable[[Path], None], words: str
) -> None:
    shutil.copy(run / FILE, fresh)
    harm(fresh / FILE)
    before = (fresh / FILE).read_bytes()
    with pytest.raises(StorageError, match=words):
        reevaluate(fresh, 4)
    assert (fresh / FILE).read_bytes() == before


def test_a_task_that_has_changed_is_not_simulated(
    fresh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = dataclasses.replace(task_spec("qd_hopper"), max_steps=7)
    monkeypatch.setattr("pga_me_ros.tasks.bullet.locomotion.QDHopper.spec", other)
    with pytest.raises(StorageError, match="its spec differs in max_steps"):
        reevaluate(fresh, 1)


@pytest.mark.parametrize(
    "numbers",
    [
        *({"repeats": count} for count in (0, -3, 99_999_999_999)),
        *({"processes": count} for count in (-1, 99_999_999_999)),
        {"best": 0},
    ],
)
def test_invalid_numbers_are_refused(run: Path, numbers: dict[str, int]) -> None:
    (name,) = numbers
    with pytest.raises(RequestError, match=f"--{name} is"):
        reevaluate(run, **{"repeats": 1, **numbers})
