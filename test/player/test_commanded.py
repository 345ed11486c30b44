"""The simulated robot as hardware: which commands its joints follow, and what it refuses."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
import pytest

from pga_me_ros.errors import RequestError, SettingsError, TaskError
from pga_me_ros.player.commanded import CommandedJoints
from pga_me_ros.player.settings import require_sense
from pga_me_ros.tasks.registry import make_task


@pytest.fixture(scope="module")
def task() -> Any:
    task = make_task("qd_hopper")
    yield task
    task.close()


@pytest.fixture
def joints(task: Any) -> CommandedJoints:
    return CommandedJoints(task)


def nothing() -> None:
    """Show nothing, and check nothing."""


def test_efforts_become_the_action_that_stands_for_them(joints: CommandedJoints) -> None:
    joints.put([75.0, -37.5, 0.1])
    action = joints.answer(nothing, nothing)
    assert action.dtype == np.float32
    np.testing.assert_array_equal(action, np.array([1.0, -0.5, 0.1 / 75.0], np.float32))


def test_in_lock_step_each_command_counts_and_in_real_time_the_newest(
    joints: CommandedJoints,
) -> None:
    assert joints.newest() is None
    for effort in (15.0, 30.0, 45.0):
        joints.put([effort, 0.0, 0.0])
    assert joints.answer(nothing, nothing)[0] == np.float32(0.2)
    for _ in range(2):
        newest = joints.newest()
        assert newest is not None
        assert newest[0] == np.float32(0.6)


def test_until_somebody_answers_the_sensors_speak_again(joints: CommandedJoints) -> None:
    spoken = threading.Event()
    answering = threading.Thread(target=lambda: spoken.wait(30.0) and joints.put([1.0, 0.0, 0.0]))
    answering.start()
    joints.shown = time.monotonic()
    joints.answer(spoken.set, nothing)
    answering.join()
    assert joints.delays[0] > 0.0


def test_answers_to_what_was_said_again_are_not_taken_for_those_to_the_next_reading(
    joints: CommandedJoints,
) -> None:
    readings = threading.Semaphore(0)

    def slow_controller() -> None:
        for _ in range(2):
            assert readings.acquire(timeout=30.0)
        for effort in (15.0, 30.0):  # it answers both: the first reading, and the same once more
            joints.put([effort, 0.0, 0.0])

    readings.release()
    answering = threading.Thread(target=slow_controller)
    answering.start()
    assert joints.answer(readings.release, nothing)[0] == np.float32(0.2)
    answering.join()
    joints.put([45.0, 0.0, 0.0])
    assert joints.answer(nothing, nothing)[0] == np.float32(0.6)


def test_what_came_before_the_first_step_is_not_taken_for_its_answer(
    joints: CommandedJoints,
) -> None:
    for effort in (15.0, 30.0):
        joints.put([effort, 0.0, 0.0])
    joints.first(nothing, nothing)
    joints.put([45.0, 0.0, 0.0])
    assert joints.answer(nothing, nothing)[0] == np.float32(0.6)


@pytest.mark.parametrize("efforts", [[], [1.0, 2.0], [1.0, 2.0, math.nan], [math.inf, 0.0, 0.0]])
def test_a_malformed_command_is_refused(joints: CommandedJoints, efforts: list[float]) -> None:
    words = "expected 3 finite efforts: thigh_joint, leg_joint, foot_joint"
    with pytest.raises(RequestError, match=words):
        joints.put(efforts)
    assert joints.newest() is None


def test_a_robot_of_unknown_efforts_cannot_be_commanded(task: Any) -> None:
    class Weightless:
        spec = task.spec
        body = type(task.body)(task.body.client, task.body.robot)

    with pytest.raises(
        TaskError, match="its body has no effort for thigh_joint, leg_joint, foot_jo"
    ):
        CommandedJoints(Weightless())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"commanded": "real_time", "speed": 0.0, "hold": 0.0},
            "but speed is 0; give a speed above",
        ),
        (
            {"commanded": "none", "speed": 1.0, "hold": 1.5},
            "hold is 1.5, but the gait itself acts;",
        ),
    ],
)
def test_parameters_that_make_no_sense_together(values: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        require_sense(values)
