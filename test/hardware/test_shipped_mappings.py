"""The mappings that come with the package: from the messages of a simulated robot to the task's own observation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from robot import SHIPPED, Sensors, controller_of

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.hardware.mapping_file import read_mapping
from pga_me_ros.hardware.observer import Observer
from pga_me_ros.tasks.registry import BUILT_IN, make_task


def test_every_built_in_robot_has_one() -> None:
    assert sorted(path.stem for path in SHIPPED.iterdir()) == sorted(BUILT_IN)


@pytest.mark.parametrize("name", BUILT_IN)
def test_observations_made_of_messages_are_those_of_the_task(name: str) -> None:
    mapping, controller = read_mapping(SHIPPED / f"{name}.yaml"), controller_of(name)
    mapping.require_fits(controller)
    observer = Observer(mapping, controller)
    task: Any = make_task(name)
    expected = task.reset(evaluation_rng(7, 0))
    sensors, rng = Sensors(task), np.random.default_rng(1)
    # An ant's target is 1 km ahead of the start; its mapping takes it to be infinitely far.
    off = 1e-3 if name == "qd_ant" else 1e-6
    touched = False
    for step in range(60):
        for source, msg in sensors.messages().items():
            observer.take(source, msg, now=float(step))
        np.testing.assert_allclose(observer.observation(), expected, rtol=0, atol=off)
        expected, _, _ = task.step(rng.uniform(-1.0, 1.0, task.spec.action_dim))
        touched |= any(task.contacts())
    assert touched
    task.close()


@pytest.mark.parametrize("name", BUILT_IN)
def test_an_action_becomes_the_torque_that_the_simulation_gives_it(name: str) -> None:
    mapping, task = read_mapping(SHIPPED / f"{name}.yaml"), make_task(name)
    efforts = {joint.name: joint.scale for joint in mapping.joints}
    assert list(efforts.items()) == list(task.body.efforts.items())  # type: ignore[attr-defined]
    task.close()
    for joint in mapping.joints:
        assert (joint.offset, joint.low, joint.high) == (0.0, -joint.scale, joint.scale)
        assert joint.rate * task.spec.control_period > 2.0 * joint.scale
