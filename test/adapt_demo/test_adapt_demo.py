"""The demonstration without its nodes: what it refuses, how its robot makes trials, its picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pga_me_msgs.msg import AdaptationTrial
from PIL import Image

from pga_me_ros.adapt_demo.__main__ import main
from pga_me_ros.adapt_demo.picture import draw
from pga_me_ros.adapt_demo.plan import DAMAGE, Plan
from pga_me_ros.adapt_demo.robot import POSES, Achieved, Robot, Way
from pga_me_ros.adapt_demo.story import Found, Map, Step, trial_row
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import Episode

SHAPE = MlpShape((15, 8, 3))


@pytest.fixture(scope="module")
def robot() -> Iterator[Robot]:
    task = make_task("qd_hopper", damage=DAMAGE)
    yield Robot(task)
    task.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--damage", "jam knee_joint"], "'knee_joint', which qd_hopper has not"),
        (["--damage", "weak left_foot_joint"], "its joints are thigh_joint, leg_joint, foot_joint"),
        (["--damage", "broken"], "damage has 'broken'"),
        (["--damage", " "], "--damage is empty"),
        (["zoo/qd_hoper"], "(did you mean 'zoo/qd_hopper'?)"),
        (["nowhere"], "'nowhere"),
        (["--budget", "0"], "budget is 0; expected a value from 1"),
        (["--length-scale", "nan"], "length_scale is nan"),
        (["--least-length-scale", "0.5"], "up to below length_scale, which is 0.4"),
        (["--repeat", "-1"], "--repeat is -1"),
        (["--out", "picture.gif"], "ends in .png, .svg, .pdf"),
        (["--out", "no_such_folder/picture.png"], "no_such_folder'; make it first"),
        (["--out", "/proc/picture.png"], "'/proc/picture.png' cannot be written"),
    ],
)
def test_bad_input_is_told_in_one_line_before_anything_starts(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert said in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_worlds_that_the_repertoire_does_not_know_are_refused(
    hopper_run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(hopper_run), "--worlds"]) == 2
    assert "were not evaluated in another world; do so first" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "worlds"), [([], True), (["--no-worlds"], False), (["--worlds"], True)]
)
def test_a_robot_may_be_in_the_worlds_that_its_repertoire_knows(
    words: list[str], worlds: bool, tmp_path: Path
) -> None:
    plan = Plan.read(["zoo/qd_hopper", "--out", str(tmp_path / "a.png"), *words])
    assert (plan.worlds is not None) == worlds


def test_what_a_controller_achieves_is_the_mean_from_all_poses(robot: Robot) -> None:
    parameters = random_parameters(SHAPE, np.random.default_rng(0))
    controller = MlpController(SHAPE, parameters)
    episodes = [robot.episode(controller, pose) for pose in range(POSES)]
    fitness = [episode.fitness for episode in episodes]
    assert len(set(fitness)) == POSES
    average = robot.average(controller)
    assert average.fitness == pytest.approx(sum(fitness) / POSES)
    assert average.falls == sum(episode.terminated for episode in episodes)
    rng = Way.ADAPT.generator(3)
    assert all(robot.trial(controller, rng).fitness in fitness for _ in range(3))


def test_a_climb_depends_on_its_repeat_alone(robot: Robot) -> None:
    begin = random_parameters(SHAPE, np.random.default_rng(1))
    climbed = [robot.climb(SHAPE, begin, Way.CLIMB.generator(repeat)) for repeat in (0, 0, 1)]
    first, again, other = (robot.average(controller).fitness for controller in climbed)
    assert first == again
    assert first != other


def test_the_default_damage_fells_the_gait_that_the_shipped_repertoire_promises_most_of(
    robot: Robot,
) -> None:
    gait = StoredRun.load("zoo/qd_hopper").choose()
    average = robot.average(gait.controller)
    assert average.falls == POSES
    assert average.fitness < gait.promised_fitness / 2


def steps(dimensions: int) -> tuple[list[Step], Map]:
    """Return an adaptation of five behaviors and two trials."""
    rng = np.random.default_rng(dimensions)
    descriptors, promised = rng.random((5, dimensions)), np.array([5.0, 9.0, 7.0, 3.0, 1.0])
    maps = [Map(descriptors, promised, promised - k, np.full(5, 3.0 - k)) for k in range(3)]
    made = []
    for k, (row, achieved) in enumerate(((1, 0.5), (2, 6.5))):
        nothing = np.zeros((1, 1), np.float32)
        episode = Episode(nothing, nothing, np.zeros(8), achieved, descriptors[row], k == 0)
        trial = AdaptationTrial(number=k + 1, cell=row, expected=maps[k].expected[row])
        made.append(Step(maps[k], row, trial, episode))
    return made, maps[-1]


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_picture_has_a_map_per_trial_and_what_was_found(
    dimensions: int, tmp_path: Path
) -> None:
    made, after = steps(dimensions)
    found = [Found("the promised gait", Achieved(0.5, 5)), Found("adaptation", Achieved(6.0, 0))]
    names = [f"foot_{k}/contact_share" for k in range(dimensions)]
    file = tmp_path / "picture.svg"
    draw(made, after, found, Achieved(9.0, 0), "a title", names, file)
    text = file.read_text()
    label = "gait, best promise first" if dimensions > 1 else "foot 0: contact share"
    for words in ("a title", "trial 1 achieves 0", "trial 2 achieves 6", label, "adaptation"):
        assert f"<!-- {words}" in text


def test_the_same_adaptation_gives_the_same_picture(tmp_path: Path) -> None:
    made, after = steps(1)
    found = [Found("adaptation", Achieved(6.0, 0))]
    files = [tmp_path / name for name in ("one.png", "two.png")]
    for file in files:
        draw(made, after, found, Achieved(9.0, 0), "a title", ["foot/contact_share"], file)
    assert files[0].read_bytes() == files[1].read_bytes()
    with Image.open(files[0]) as picture:
        assert min(picture.size) > 400
        assert len(picture.convert("RGB").getcolors(1 << 24) or ()) > 100


def test_a_trial_is_told_with_its_promise_and_its_end() -> None:
    fell, went_on = steps(1)[0]
    assert trial_row(fell, 0.25).split() == ["1", "1", "0", "9", "0", "fell", "after", "2.0", "s"]
    assert trial_row(went_on, 0.25).endswith("went on for 2.0 s")
