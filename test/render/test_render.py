"""Pictures of a small stored repertoire, drawn by the program and inspected."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pybullet
import pytest
from PIL import Image

from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.metrics import generation_metrics
from pga_me_ros.core.archive.spread import spread_cells
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import random_parameters
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.reevaluations import Reevaluations, RepeatOutcome
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.library import StoredRun
from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.camera import FIELD_OF_VIEW, Camera
from pga_me_ros.player.promise import kept
from pga_me_ros.render import animation
from pga_me_ros.render.__main__ import main
from pga_me_ros.render.contact_sheet import GAP, HEAD, LABEL
from pga_me_ros.render.labels import wrapped
from pga_me_ros.render.scene import Scene
from pga_me_ros.tasks.registry import make_task, task_spec
from pga_me_ros.tasks.rollout import rollout

B = 6
SPEC = task_spec("qd_hopper")
SETTINGS = Settings(
    task="qd_hopper",
    seed=4,
    batch_size=B,
    n_evo=2,
    cells=64,
    cvt_samples=2000,
    controller_hidden=(16,),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of one generation of hoppers with real evaluations."""
    folder = tmp_path_factory.mktemp("hop")
    shape = controller_shape(SPEC, SETTINGS)
    rng = np.random.default_rng(0)
    parameters = np.stack([random_parameters(shape, rng) for _ in range(B)])
    task = make_task("qd_hopper")
    done = [
        rollout(task, MlpController(shape, p), evaluation_rng(SETTINGS.seed, k))
        for k, p in enumerate(parameters)
    ]
    task.close()
    solutions = Solutions.of(
        fitness=[e.fitness for e in done],
        descriptors=[e.descriptor for e in done],
        parameters=parameters,
        evaluations=range(B),
        generation=0,
        steps=[e.length for e in done],
        terminated=[e.terminated for e in done],
    )
    info = RunInfo(
        run_id="hoppers",
        settings=SETTINGS.to_dict(),
        task=SPEC.to_json(),
        layer_sizes=shape.sizes,
        activations=("relu", "tanh"),
        versions={},
        created="2026-01-01T00:00:00+00:00",
    )
    archive = make_archive(SPEC, SETTINGS)
    with Repertoire.create(folder / "repertoire.db", info, archive) as file:
        added = archive.add(solutions)
        elites = [archive.elite(cell) for cell in added.changed_cells.tolist()]
        file.commit(0, elites, generation_metrics(archive, solutions, added, 0, None), {})
    return folder


@pytest.fixture
def render(run: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., str]]:
    """Return a function that runs the program, checks that it succeeds, and returns its output."""

    def draw(*arguments: object) -> str:
        assert main([str(run), *map(str, arguments)]) == 0
        return capsys.readouterr().err

    return draw


def frames(path: Path) -> list[np.ndarray]:
    with Image.open(path) as image:
        found = []
        for k in range(image.n_frames):
            image.seek(k)
            found.append(np.asarray(image.convert("RGB")).astype(int))
    return found


def robot(picture: np.ndarray) -> np.ndarray:
    """Return where a picture has saturated colors, which only the robot has."""
    return picture.max(axis=2) - picture.min(axis=2) > 60


def test_a_gif_shows_the_robot_moving_and_well_in_the_picture(
    render: Callable[..., str], tmp_path: Path
) -> None:
    out = tmp_path / "gait.gif"
    words = render("--best", "--out", out, "--size", 200, 150, "--fps", 30)
    assert re.search(r": equal; (fell after|went on for) \d+\.\d s", words)
    pictures = frames(out)
    assert len(pictures) > 5
    for picture in pictures:
        rows, columns = np.nonzero(robot(picture))
        assert rows.size > 300
        assert rows.min() > 0
        assert rows.max() < 149
        assert columns.min() > 0
        assert columns.max() < 199
    first, last = robot(pictures[0]), robot(pictures[-1])
    assert (first != last).sum() > 0.2 * first.sum()


def test_a_damaged_robot_is_drawn_without_what_it_lost(
    render: Callable[..., str], tmp_path: Path
) -> None:
    seen = []
    for damage in ("", "gone leg_joint"):
        out = tmp_path / "gait.gif"
        small = ("--size", 120, 90, "--fps", 5)
        words = render("--best", "--out", out, "--damage", damage, *small)
        assert (": different; " if damage else ": equal; ") in words
        rows, columns = np.nonzero(robot(frames(out)[0]))
        seen.append((np.ptp(columns) + 1) / (np.ptp(rows) + 1))
    assert seen[1] < 0.6 * seen[0], "a hopper without its foot is slender"


def test_another_start_is_compared_with_what_was_found_or_with_the_mean(
    run: Path, render: Callable[..., str], tmp_path: Path
) -> None:
    best = StoredRun.load(run).archive.best()
    small = ("--out", tmp_path / "gait.gif", "--size", 60, 40)
    assert ": different; " in render("--best", "--seed", 3, *small)
    outcomes = [
        RepeatOutcome(best.evaluation, k, best.fitness + k, best.descriptor, 9, True)
        for k in range(2)
    ]
    copy = Path(shutil.copytree(run, tmp_path / "again"))
    Reevaluations.none("hoppers", 1).with_more(outcomes).save(copy / "repertoire.db")
    task = make_task("qd_hopper")
    gait = StoredRun.load(copy).choose(cell=best.cell)
    episode = StoredRun.load(copy).rollout(gait, 3, task)
    task.close()
    words = kept(gait, episode, fresh=True)
    assert f"fitness {best.fitness + 0.5:.2f} ± 0.71" in words
    assert "on average of 2 re-evaluations, 100 % of them falls: fitness " in words
    assert kept(gait, StoredRun.load(copy).rollout(gait)).endswith(": equal")
    single = StoredRun.load(copy).choose(cell=best.cell, single=True)
    assert kept(single, episode, fresh=True).endswith(": different")


def test_a_gif_lasts_as_long_as_the_episode(
    run: Path, render: Callable[..., str], tmp_path: Path
) -> None:
    out = tmp_path / "gait.gif"
    render("--out", out, "--size", 80, 60, "--speed", 0.5)
    with Image.open(out) as image:
        durations = []
        for k in range(image.n_frames):
            image.seek(k)
            durations.append(image.info["duration"])
    archive = StoredRun.load(run).archive
    steps = 3 * (archive.best().steps // 3)  # a frame after every third step
    assert sum(durations[:-1]) == pytest.approx(1000 * 2 * steps * SPEC.control_period, abs=10)


def test_a_contact_sheet_has_a_row_per_gait(
    run: Path, render: Callable[..., str], tmp_path: Path
) -> None:
    out = tmp_path / "sheet.png"
    words = render("--sheet", 3, "--columns", 4, "--out", out).splitlines()
    assert [word.rsplit(": ", 1)[1].partition(";")[0] for word in words] == ["equal"] * 3
    with Image.open(out) as image:
        sheet = np.asarray(image.convert("RGB")).astype(int)
    assert sheet.shape == (HEAD + 3 * (132 + GAP), LABEL + 4 * (176 + GAP), 3)
    for i in range(3):
        top = HEAD + i * (132 + GAP)
        assert (sheet[top : top + 132, :LABEL].max(axis=2) < 120).sum() > 100, "words"
        for j in range(4):
            left = LABEL + j * (176 + GAP)
            assert robot(sheet[top : top + 132, left : left + 176]).sum() > 150


def test_a_gallery_shows_gaits_in_step_until_the_last_one_has_ended(
    run: Path, render: Callable[..., str], tmp_path: Path
) -> None:
    out = tmp_path / "gallery.gif"
    small = ("--size", 150, 110, "--fps", 30)
    words = render("--gallery", 3, "--columns", 2, "--out", out, *small).splitlines()
    assert [word.rsplit(": ", 1)[1].partition(";")[0] for word in words] == ["equal"] * 3
    archive = StoredRun.load(run).archive
    cells = spread_cells(archive, archive.filled_cells(), 3)
    assert [int(word.split()[1].rstrip(":")) for word in words] == cells
    counts = [int(archive.steps[cell]) // 2 for cell in cells]  # a picture after every 2nd step
    films, gap = frames(out), animation.GAP
    assert len(films) == max(counts) + 1
    assert films[0].shape == (2 * 110 + gap, 2 * 150 + gap, 3)
    for i, count in enumerate(counts):
        top, left = i // 2 * (110 + gap), i % 2 * (150 + gap)
        parts = [film[top : top + 110, left : left + 150] for film in films]
        assert (robot(parts[0]) != robot(parts[count])).any(), "it moves"
        for part in parts[count:]:
            np.testing.assert_array_equal(part, parts[count], "its last picture stays")
    assert not robot(films[0][110 + gap :, 150 + gap :]).any(), "the fourth place is empty"


def test_words_are_wrapped_to_the_width_of_a_picture() -> None:
    words = ["[0.35]", "fitness 2162", "mean of 12", "0 % fall"]
    assert wrapped(words, 1000, 13) == [", ".join(words)]
    assert wrapped(words, 10, 13) == words
    lines = wrapped(words, 150, 13)
    assert ", ".join(lines) == ", ".join(words)
    assert 1 < len(lines) < 4


def test_the_gaits_of_a_sheet_are_far_apart(run: Path) -> None:
    archive = StoredRun.load(run).archive
    cells = spread_cells(archive, archive.filled_cells(), 3)
    values = archive.descriptors[cells][:, 0]
    filled = archive.descriptors[archive.filled_cells()][:, 0]
    assert archive.best().cell in cells
    assert list(values) == sorted(values)
    assert {filled.min(), filled.max()} & set(values)
    best = np.array([archive.best().cell])
    assert spread_cells(archive, best, 100) == best.tolist()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--cell", "0"], "Cell 0 is empty"),
        (["--descriptor", "0.1", "0.2"], "The descriptor has 2 entries; this repertoire's has 1"),
        (["--min-fitness", "1e6"], "No behavior has a fitness of 1000000.0 or more"),
        (
            ["--sheet", "2", "--min-fitness", "1e6"],
            "No behavior has a fitness of 1000000.0 or more",
        ),
        (["--out", "gait.png"], "ends in .gif"),
        (["--out", "nowhere/gait.gif"], "nowhere'; make it first"),
        (["--sheet", "2", "--out", "/proc/gaits.png"], "'/proc/gaits.png' cannot be written"),
        (["--out", f"{'a' * 300}.gif"], "cannot be written (File name too long)"),
        (["--start", "1e3"], "give a smaller start"),
        (["--start", "-3"], "start is -3; give a number from 0 to 1,000,000"),
        (["--start", "nan"], "start is or holds nan; give a number"),
        (["--seconds", "inf"], "seconds is inf; give a number from 0.001 to 1,000,000"),
        (["--speed", "1e-5"], "speed is 1e-05; give a number from 0.001 to 1,000"),
        (["--fps", "1e-320"], "give a number from 0.01 to 1,000"),
        (["--fps", "4", "--speed", "0.0001"], "speed is 0.0001"),
        (["--size", "70000", "70000"], "size is 70000 x 70000; give a width and a height of 1 to"),
        (["--size", "0", "90"], "size is 0 x 90; give a width"),
        (["--sheet", "2", "--size", "90", "90"], "--size is about a GIF"),
        (["--sheet", "2", "--start", "0"], "--start is about a GIF"),
        (["--sheet", "2", "--columns", "1000000"], "--columns is 1000000; give 1 to 100"),
        (["--columns", "2"], "--columns is about --sheet and --gallery"),
        (["--damage", "jam knee"], "which qd_hopper has not"),
    ],
)
def test_what_cannot_be_drawn_is_reported_in_one_line(
    run: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main([str(run), *arguments]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("error: ")
    assert message in error


def test_the_picture_shows_the_simulated_robot() -> None:
    """The copy that is posed for the picture covers the same pixels as the simulated robot."""
    task = make_task("qd_walker")
    task.reset(np.random.default_rng(3))
    reader = BodyReader(task.body)  # type: ignore[attr-defined]
    state = reader.state()
    camera = Camera.for_robot(reader.model, state)
    scene = Scene(reader.model, 320, 240)
    copy = robot(scene.picture(state, camera).astype(int))
    scene.close()
    body = task.body  # type: ignore[attr-defined]
    _, _, _, _, bodies = pybullet.getCameraImage(
        320,
        240,
        pybullet.computeViewMatrix(camera.eye(state), camera.target(state), (0.0, 0.0, 1.0)),
        pybullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, 320 / 240, 0.1, 50.0),
        renderer=pybullet.ER_TINY_RENDERER,
        physicsClientId=body.client,
    )
    simulated = np.array(bodies).reshape(240, 320) == body.robot
    task.close()
    assert (copy & simulated).sum() > 0.93 * (copy | simulated).sum()
