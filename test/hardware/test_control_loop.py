"""From readings to commands, without ROS; the loop closed over a simulated robot gives the gait that was evaluated."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from robot import SHIPPED, Sensors, controller_of

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.errors import SettingsError
from pga_me_ros.hardware.control_loop import ControlLoop
from pga_me_ros.hardware.guard import State
from pga_me_ros.hardware.mapping_file import read_mapping
from pga_me_ros.hardware.settings import HardwareSettings
from pga_me_ros.tasks.registry import BUILT_IN, make_task
from pga_me_ros.tasks.rollout import rollout

MAPPINGS = {name: read_mapping(SHIPPED / f"{name}.yaml") for name in BUILT_IN}


def loop_of(task: str, **changed: Any) -> ControlLoop:
    values = {**dataclasses.asdict(HardwareSettings()), "ramp": 0.0, **changed}
    return ControlLoop(MAPPINGS[task], controller_of(task), values)


@pytest.mark.parametrize("name", ["qd_hopper", "qd_walker", "qd_half_cheetah"])
def test_the_loop_closed_over_messages_is_the_episode_of_the_controller(name: str) -> None:
    loop, task = loop_of(name), make_task(name)
    efforts = np.array(list(task.body.efforts.values()))  # type: ignore[attr-defined]
    expected = rollout(task, controller_of(name), evaluation_rng(3, 1), 150)
    sensors, steps = Sensors(task), iter(range(1000))

    def act(_: Any) -> Any:
        now = loop.period * next(steps)
        for source, msg in sensors.messages().items():
            loop.observer.take(source, msg, now)
        command = loop.step(now)
        assert command is not None
        return (command / efforts).astype(np.float32)

    assert rollout(task, act, evaluation_rng(3, 1), 150) == expected
    assert expected.length > 5
    task.close()


def test_stale_sensors_freeze_it_and_their_return_alone_does_not_release_it() -> None:
    loop, task = loop_of("qd_hopper", timeout=0.1), make_task("qd_hopper")
    assert loop.step(0.0) is None
    readings = Sensors(task).messages()
    task.close()
    for now, heard, state in (
        (1.0, True, State.RUNNING),
        (1.09, False, State.RUNNING),
        (1.11, False, State.FROZEN),
        (1.12, True, State.FROZEN),
    ):
        if heard:
            for source, msg in readings.items():
                loop.observer.take(source, msg, now)
        command = loop.step(now)
        assert command is not None
        assert loop.guard.state is state
        assert command.any() == (state is State.RUNNING)
    assert loop.guard.reason == "position.z on topic 'odom' is 0.11 s old"


def test_positions_begin_where_the_joints_are_and_reach_what_the_action_stands_for() -> None:
    hopper = MAPPINGS["qd_hopper"]
    joints = tuple(
        dataclasses.replace(joint, scale=0.5, offset=-0.5, low=-1.0, high=0.0, rate=1000.0)
        for joint in hopper.joints
    )
    mapping = dataclasses.replace(hopper, positions=True, joints=joints)
    controller, task = controller_of("qd_hopper"), make_task("qd_hopper")
    values = {**dataclasses.asdict(HardwareSettings()), "ramp": 2 * controller.control_period}
    loop = ControlLoop(mapping, controller, values)
    observation = task.reset(evaluation_rng(3, 1))
    for source, msg in Sensors(task).messages().items():
        loop.observer.take(source, msg, 0.0)
    measured = np.array(task.joint_states()[0])  # type: ignore[attr-defined]
    task.close()
    wanted = 0.5 * controller(observation).astype(np.float64) - 0.5
    half = np.clip(measured + 0.5 * (wanted - measured), -1.0, 0.0)
    np.testing.assert_allclose(loop.step(0.0), half, atol=1e-12)
    np.testing.assert_array_equal(loop.step(0.0), wanted)


def test_joints_get_the_actions_that_the_mapping_gives_them() -> None:
    hopper, controller = MAPPINGS["qd_hopper"], controller_of("qd_hopper")
    mapping = dataclasses.replace(hopper, joints=hopper.joints[::-1])
    values = {**dataclasses.asdict(HardwareSettings()), "ramp": 0.0}
    loop, task = ControlLoop(mapping, controller, values), make_task("qd_hopper")
    observation = task.reset(evaluation_rng(3, 1))
    for source, msg in Sensors(task).messages().items():
        loop.observer.take(source, msg, 0.0)
    task.close()
    command = loop.step(0.0)
    np.testing.assert_array_equal(command, 75.0 * controller(observation)[::-1].astype(np.float64))


def commands_of(loop: ControlLoop, triggers: list[float]) -> int:
    """Return how many of the moments at which a trigger comes, in control periods, are answered."""
    count = 0
    for moment in triggers:
        if loop.due(moment * loop.period):
            loop.step(moment * loop.period)
            count += 1
    return count


def test_a_trigger_that_comes_often_gives_commands_at_the_control_period() -> None:
    often = [0.06 * k for k in range(1500)]  # 90 periods
    assert 90 <= commands_of(loop_of("qd_hopper"), often) <= 91
    assert commands_of(loop_of("qd_hopper", simulated=True), often) == 1500


def test_a_trigger_at_the_control_period_is_always_answered_though_some_are_late() -> None:
    late = [float(k) + (0.5 if k % 10 == 3 else 0.0) for k in range(100)]
    assert commands_of(loop_of("qd_hopper"), late) == 100


@pytest.mark.parametrize(("every", "answered"), [(0.95, 100), (0.6, 60), (0.3, 30), (1.3, 100)])
def test_a_trigger_near_the_control_period_is_always_answered_others_at_most_once_in_it(
    every: float, answered: int
) -> None:
    jitter = np.random.default_rng(1).uniform(-0.02, 0.02, 100)
    triggers = [every * k + j for k, j in enumerate(jitter)]
    assert abs(commands_of(loop_of("qd_hopper"), triggers) - answered) <= 1


def test_a_trigger_that_is_no_source_is_refused() -> None:
    words = (
        r"trigger is 'joint' \(did you mean 'joints'\?\), but the sources of .* are joints, odom"
    )
    with pytest.raises(SettingsError, match=words):
        loop_of("qd_hopper", trigger="joint")


def test_a_period_that_cannot_be_kept_is_refused() -> None:
    values = dataclasses.asdict(HardwareSettings())
    words = r"An action takes .* ms here, but the behavior's control period is 1e-05 ms; use a fast"
    with pytest.raises(SettingsError, match=words):
        ControlLoop(MAPPINGS["qd_hopper"], controller_of("qd_hopper", control_period=1e-8), values)
