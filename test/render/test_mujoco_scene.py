"""Pictures of MuJoCo's robots: by its own renderer where there is OpenGL, by PyBullet's where there is none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pga_me_ros.player.camera import Camera
from pga_me_ros.player.watched_rollout import Recording, record
from pga_me_ros.render.__main__ import main
from pga_me_ros.render.mujoco_scene import CHOICE, MujocoScene, NoOpenGLError
from pga_me_ros.render.open_scene import open_scene
from pga_me_ros.render.scene import Scene
from pga_me_ros.tasks.registry import make_task

SIZE = (160, 120)


@pytest.fixture(scope="module")
def recording() -> Iterator[Recording]:
    """Return a few steps of a half-cheetah, whose torso's axes of inertia lie askew."""
    task = make_task("gymnasium:HalfCheetah-v5?max_steps=30")
    rng = np.random.default_rng(2)
    yield record(task, lambda _: rng.uniform(-1, 1, 6).astype(np.float32), np.random.default_rng(1))
    task.close()


def scene_of_mujoco(recording: Recording) -> MujocoScene:
    try:
        return MujocoScene(recording.body, *SIZE)
    except NoOpenGLError as error:
        pytest.skip(str(error))


def robot(picture: np.ndarray) -> np.ndarray:
    """Return the pixels of the cheetah: its skin is the only thing much redder than blue."""
    colors = picture.astype(int)
    return colors[..., 0] - colors[..., 2] > 25


def test_both_renderers_show_the_robot_in_the_same_place(recording: Recording) -> None:
    state = recording.states[-1]
    camera = Camera.for_robot(recording.model, recording.states[0])
    scenes = (scene_of_mujoco(recording), Scene(recording.model, *SIZE))
    ours, theirs = (robot(scene.picture(state, camera)) for scene in scenes)
    for scene in scenes:
        scene.close()
        scene.close()
    assert (ours & theirs).sum() > 0.7 * (ours | theirs).sum()


def test_drawing_changes_neither_model_nor_simulation(recording: Recording) -> None:
    body = recording.body
    before = body.data.qpos.copy(), body.data.qvel.copy(), body.model.vis.global_.offwidth
    scene = scene_of_mujoco(recording)
    scene.picture(recording.states[0], Camera.for_robot(recording.model, recording.states[0]))
    scene.close()
    assert np.array_equal(body.data.qpos, before[0])
    assert np.array_equal(body.data.qvel, before[1])
    assert body.model.vis.global_.offwidth == before[2]


def test_the_floor_does_not_end(recording: Recording) -> None:
    """Thirty periods of the floor's pattern further on, beyond its edge, the picture is the same."""
    start = recording.states[0]
    camera = Camera.for_robot(recording.model, start)
    scene = scene_of_mujoco(recording)
    pictures = []
    for away in (0.0, 40.0):  # 30 x 80 m / 60
        x, *others = start.configuration
        base = start.base._replace(
            position=(start.base.position[0] + away, *start.base.position[1:])
        )
        state = replace(start, base=base, configuration=(x + away, *others))
        pictures.append(scene.picture(state, camera).astype(int))
    scene.close()
    assert np.abs(pictures[1] - pictures[0]).mean() < 3.0


def test_without_opengl_it_is_said_and_drawn_otherwise(
    recording: Recording, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(CHOICE, "nothing")
    scene = open_scene(recording, *SIZE)
    assert isinstance(scene, Scene)
    scene.close()
    note = capsys.readouterr().err
    assert note.count("\n") == 1
    assert note.startswith("note: drawn by PyBullet's renderer instead: MuJoCo's renderer finds no")
    assert "set MUJOCO_GL" in note


def test_a_run_is_drawn(new_run: Callable[..., Path], tmp_path: Path) -> None:
    run = new_run(task="gymnasium:Hopper-v5?max_steps=40", evaluations=10, random_init=10)
    gif, sheet = tmp_path / "gait.gif", tmp_path / "gaits.png"
    assert main([str(run), "--best", "--out", str(gif), "--fps", "10"]) == 0
    assert main([str(run), "--sheet", "2", "--columns", "2", "--out", str(sheet)]) == 0
    with Image.open(gif) as picture:
        assert picture.n_frames > 1
    with Image.open(sheet) as picture:
        assert len(picture.getcolors(1 << 20) or []) > 100
