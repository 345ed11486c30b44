"""What the page is given: descriptions of runs, packed motions, and one file without references to anywhere."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from pga_me_msgs.srv import GetInfo, ListGenerations

from pga_me_ros.client import ListedGeneration, RepertoireInfo
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.dependencies import WEB
from pga_me_ros.errors import TaskError
from pga_me_ros.explorer import page
from pga_me_ros.explorer.__main__ import MOTIONS, main
from pga_me_ros.explorer.description import describe
from pga_me_ros.explorer.history import History
from pga_me_ros.explorer.motion import LEVELS, EpisodeStart, describe_motion, pack, recorded
from pga_me_ros.explorer.recorder import Recorder, chosen_cells
from pga_me_ros.explorer.served_archive import served_archive, spec_of
from pga_me_ros.player.watched_rollout import record
from pga_me_ros.serving.generations import list_generations
from pga_me_ros.tasks.registry import make_task

ZOO = Path("zoo/qd_hopper")


@pytest.fixture(scope="module")
def run() -> StoredRun:
    return StoredRun.load(ZOO)


def unpacked(packed: dict) -> np.ndarray:
    """Return the table that `pack` packed, as the page reads it."""
    raw = np.frombuffer(base64.b64decode(packed["data"]), "<u2")
    return packed["low"] + np.array(packed["step"]) * raw.reshape(-1, packed["columns"])


def test_a_description_has_the_figures_of_every_elite(run: StoredRun) -> None:
    elites = json.loads(json.dumps(describe(run, "x"), allow_nan=False))["elites"]
    assert {len(column) for column in elites.values()} == {len(run.archive)}
    for row, cell in enumerate(elites["cell"]):
        behavior = run.behavior(cell)
        assert elites["fitness"][row] == behavior.fitness
        assert elites["mean_fitness"][row] == behavior.mean_fitness
        assert elites["fall_share"][row] == behavior.fall_share
        assert elites["parents"][row] == list(behavior.parents)
        assert elites["mean_cell"][row] == run.archive.cell_of(behavior.mean_descriptor[None])[0]


@pytest.mark.parametrize("shipped", [True, False], ids=["re-evaluated", "as it grew"])
def test_the_history_that_a_graph_tells_is_that_of_the_file(
    hopper_run: Path, shipped: bool
) -> None:
    run = StoredRun.load(ZOO if shipped else hopper_run)
    measured = {m.generation: m.corrected for m in run.reevaluations.measured}
    history = History()
    with Repertoire.open(run.file, read_only=True) as file:
        for first in range(len(run.generations)):
            response = ListGenerations.Response()
            request = ListGenerations.Request(first=first, limit=2)  # some come twice
            list_generations(file, run.archive.cells, measured, request, response)
            history.extend(ListedGeneration.from_response(response))
    stored, told = describe(run, "x"), history.described()
    assert told["curves"] == stored["curves"]
    assert told["contributions"] == stored["contributions"]
    for mine, theirs in zip(told["measured"], stored["measured"], strict=True):
        assert mine == {name: theirs[name] for name in mine}


def test_a_served_task_that_is_unknown_here_has_its_cells() -> None:
    response = GetInfo.Response(task="lane", archive="cvt", settings="{}", versions="{}")
    response.descriptor_names = ["x", "y"]
    response.descriptor_low, response.descriptor_high = [0.0, -1.0], [1.0, 2.0]
    response.metrics.cells = 30
    info = RepertoireInfo.from_response(response)
    settings = Settings(task="nowhere:Lane", cells=30, cvt_samples=1000)
    spec, known = spec_of(info, settings)
    archive, _ = served_archive(spec, settings, [])
    assert (known, archive.cells) == (False, 30)
    assert archive.centroids.min(axis=0)[1] < 0.0 < 1.0 < archive.centroids.max(axis=0)[1]
    with pytest.raises(TaskError, match="nowhere"):
        spec_of(dataclasses.replace(info, archive="grid"), settings)


def test_what_was_not_evaluated_again_is_null(hopper_run: Path) -> None:
    elites = describe(StoredRun.load(hopper_run), "x")["elites"]
    assert set(elites["mean_fitness"]) == set(elites["mean_cell"]) == {None}
    assert all(set(row) == {None} for row in elites["mean_descriptor"])


def test_packed_numbers_differ_by_half_a_step_at_most() -> None:
    table = np.random.default_rng(0).normal(size=(50, 4)) * [1.0, 100.0, 1e-3, 0.0] + 3.0
    packed = pack(table, LEVELS)
    assert np.all(np.abs(unpacked(packed) - table) <= 0.5001 * np.array(packed["step"]) + 1e-12)


@pytest.mark.parametrize(
    "start", [EpisodeStart(), EpisodeStart(seed=1)], ids=["evaluation", "unseen"]
)
def test_a_motion_is_that_of_the_rollout(run: StoredRun, start: EpisodeStart) -> None:
    task = make_task(run.settings.task)
    gait = run.choose(best=True)
    motion = describe_motion(recorded(task, run.settings, gait, start), run.spec, gait, start)
    rng = evaluation_rng(run.settings.seed, gait.evaluation)
    if start.seed is not None:
        rng = np.random.default_rng(start.seed)
    whole = record(task, gait.controller, rng)
    task.close()
    steps = np.rint(np.array(motion["seconds"]) / run.spec.control_period).astype(int)
    expected = np.array([[*s.base.position, *s.positions] for s in whole.states])[steps]
    frames = unpacked(motion["frames"])
    assert np.abs(np.delete(frames, range(3, 7), axis=1) - expected).max() < 1e-3
    assert (motion["fitness"], motion["fell"]) == (whole.episode.fitness, whole.episode.terminated)
    assert motion["kept"] is (True if start.seed is None else None)


def test_the_strip_averages_to_the_descriptor(run: StoredRun) -> None:
    recorder = Recorder(run.settings, run.behavior)
    behavior = run.choose(best=True)
    strip = recorder.motion(behavior.cell, EpisodeStart())["strip"]
    recorder.close()
    values = np.frombuffer(base64.b64decode(strip["data"]), "u1") * strip["step"][0]
    assert values.mean() == pytest.approx(behavior.descriptor[0], abs=0.01)  # every other step


def test_64_gaits_of_the_largest_robot_take_less_than_15_megabytes() -> None:
    steps, columns = 500, 7 + 8  # half of an ant's episode; its base, and eight joints
    frames = pack(np.random.default_rng(0).normal(size=(steps, columns)), LEVELS)
    strip = pack(np.random.default_rng(0).random((steps, 4)), 255)
    motion = {
        "frames": frames,
        "strip": strip,
        "seconds": [round(k * 0.033, 6) for k in range(steps)],
    }
    three = len(page.build_page({"title": "", "runs": []}))
    assert three + 2 * MOTIONS * len(json.dumps(motion)) < 15e6


def test_chosen_cells_have_the_best_gait(run: StoredRun) -> None:
    cells = chosen_cells(run, 5)
    assert len(cells) == 5
    assert run.choose(best=True).cell in cells
    assert chosen_cells(run, 0) == []


def test_the_page_refers_to_nothing_elsewhere() -> None:
    text = page.build_page({"title": "a </script><b>", "runs": [{"name": "</script><!--"}]})
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", text)
    assert "@import" not in text
    assert text.count("<script") == text.count("</script>") == len(page.SCRIPTS) + 2
    assert "a &lt;/script&gt;&lt;b&gt;" in text
    own = sorted(path.name for path in Path(page.__file__).with_name("web").glob("*.js"))
    assert own == sorted(page.SCRIPTS)


def test_scripts_are_short_enough_to_read() -> None:
    files = Path(page.__file__).with_name("web").iterdir()
    assert {f.name: n for f in files if (n := len(f.read_text().splitlines())) > 330} == {}


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--html", "page.txt"], "ends in .html"),
        (["--html", "nowhere/page.html"], "make it first"),
        (["--html", "page.html", "--randomization", "wind 1 2"], "KIND is one of"),
        (["--html", "page.html", "--port", "0"], "--port has a meaning not with --html"),
        (["--html", "page.html", "--graph", "/"], "--html writes stored runs only"),
        (["--motions", "3"], "--motions has a meaning only with --html"),
        (["--graph", "left"], "'left' does not begin with a slash; expected --graph /left"),
        (["--graph", "/a", "--graph", "/a"], "a namespace twice"),
        (["--ros-args", "-r", "__ns:=/left"], "only stored runs are named"),
    ],
)
def test_bad_arguments_are_told_in_one_line(
    args: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([str(ZOO), *args]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_told_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    assert main([str(ZOO), "--html", str(tmp_path / "page.html")]) == 2
    assert f"pip install {WEB}" in capsys.readouterr().err
