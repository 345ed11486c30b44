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
