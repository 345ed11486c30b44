"""Controllers, mappings and messages of the simulated robots, for tests of the package hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time

from pga_me_ros.client import Controller
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.commanded import SensorMessages
from pga_me_ros.player.messages import RobotMessages
from pga_me_ros.ros.convert import controller_to_msg
from pga_me_ros.tasks.registry import task_spec

SHIPPED = Path(__file__).resolve().parents[2] / "config" / "hardware"


def controller_of(task: str, **changed: Any) -> Controller:
    """Return a random controller of a task; `changed` replaces fields of its message."""
    spec = task_spec(task)
    shape = MlpShape((spec.observation_dim, 16, spec.action_dim))
    msg = controller_to_msg(random_parameters(shape, np.random.default_rng(1)), shape, spec)
    for name, value in changed.items():
        setattr(msg, name, value)
    return Controller.from_msg(msg)


class Sensors:
    """The messages of a simulated robot, as `behavior_player` publishes them.

    Args:
        task: The task.
    """

    def __init__(self, task: Any) -> None:
        self._task = task
        self._reader = BodyReader(task.body)
        self._messages = RobotMessages(self._reader.model)
        self._others = SensorMessages(self._reader.model)

    def messages(self) -> dict[str, Any]:
        """Return what the sensors say now, by the names of the shipped mappings' sources."""
        state, stamp = self._reader.state().as_told(), Time()
        return {
            "joints": self._messages.joint_state(state, stamp),
            "odometry": self._messages.odometry(state, stamp),
            "imu": self._others.imu(state, stamp),
            "contacts": self._others.contacts(self._task),
        }
