"""One robot under control, without ROS: readings in, safe commands out."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.client import Controller
from pga_me_ros.errors import SettingsError, nearest_name
from pga_me_ros.hardware.guard import Guard, Limits, State, ramp_steps
from pga_me_ros.hardware.mapping import RobotMapping
from pga_me_ros.hardware.observer import Observer
from pga_me_ros.hardware.timing import Timing

EARLY = 0.6
"""Control periods by which a command may come before its turn, after one that was late."""

NEAR = 0.9
"""Control periods between two triggers from which on each is answered: a sensor's clock may run a little fast, and a
message that is left out makes a gap of two periods."""

TRIALS = 50
"""Actions that are computed at the start to see how long one takes."""


class ControlLoop:
    """Turns readings into commands, one per control period.

    Times are seconds of a clock that never jumps.

    Args:
        mapping: The robot.
        controller: The behavior.
        values: Values of `HardwareSettings` by name.

    Attributes:
        observer: Takes the readings.
        guard: Keeps the commands safe.
        timing: Measures how punctual they are.
        period: Control period, s.

    Raises:
        SettingsError: The mapping is that of another robot, there is no source `trigger`, or an action takes longer
            than the control period.
    """

    def __init__(
        self, mapping: RobotMapping, controller: Controller, values: Mapping[str, Any]
    ) -> None:
        mapping.require_fits(controller)
        if values["trigger"] not in ("", *mapping.sources):
            raise SettingsError(
                f"trigger is '{values['trigger']}'{nearest_name(values['trigger'], mapping.sources)}, but the sources "
                f"of '{mapping.path}' are {', '.join(mapping.sources)}."
            )
        self.period = controller.control_period
        require_fast_enough(controller)
        self._controller = controller
        self._timeout: float = values["timeout"]
        self._simulated: bool = values["simulated"]
        self._turn = self._triggered = -math.inf
        joints = mapping.joints
        self._scale = np.array([joint.scale for joint in joints])
        self._offset = np.array([joint.offset for joint in joints])
        self._order = [controller.action_names.index(joint.action) for joint in joints]
        self._limits = (controller.action_low, controller.action_high)
        limits = Limits(
            low=np.array([joint.low for joint in joints]),
            high=np.array([joint.high for joint in joints]),
            step=np.array([joint.rate for joint in joints]) * self.period,
        )
        self.guard = Guard(
            limits,
            ramp_steps=ramp_steps(values["ramp"], self.period),
            positions=mapping.positions,
            hold=values["frozen"] == "hold",
            resume=values["resume"],
        )
        self.observer = Observer(mapping, controller)
        self.timing = Timing(self.period)

    def due(self, now: float) -> bool:
        """Whether a message that triggers, and has just come, is answered by a command.

        Of messages that come often, as many are as there are control periods: rates and ramps hold in real time.
        """
        since, self._triggered = now - self._triggered, now
        return self._simulated or now >= self._turn or since >= NEAR * self.period

    @property
    def shortest_timeout(self) -> float:
        """Least age at which a reading is stale, s."""
        return self.observer.shortest_timeout(self._timeout)

    def missing(self, now: float) -> str:
        """Return which readings are stale, in words; empty for none."""
        return self.observer.missing(now, self._timeout)

    def step(self, now: float) -> Float64Array | None:
        """Return the command for the control period that begins now.

        Returns:
            (n,) float64, in the order of the mapping's joints; None if there is nothing to command yet.
        """
        turn = self._turn if self._turn <= now else -math.inf  # else a near one was answered early
        self._turn = max(turn, now - EARLY * self.period) + self.period
        missing = self.missing(now)
        if missing:
            return self.guard.freeze(missing)
        action = np.clip(self._controller(self.observer.observation()), *self._limits)
        wanted = self._scale * action[self._order].astype(np.float64) + self._offset
        return self.guard.command(wanted, self.observer.positions())

    def sent(self, now: float) -> None:
        """Note that a command was sent."""
        if self.guard.state in (State.RAMPING, State.RUNNING):
            self.timing.add(self.observer.newest(), now)
        else:
            self.timing.pause()


def require_fast_enough(controller: Controller) -> None:
    """Check that an action takes less than the control period.

    Raises:
        SettingsError: It takes longer.
    """
    observation = np.zeros(controller.layer_sizes[0], np.float32)
    times = []
    for _ in range(TRIALS):
        begin = time.perf_counter()
        controller(observation)
        times.append(time.perf_counter() - begin)
    needed = float(np.median(times))
    if needed >= controller.control_period:
        raise SettingsError(
            f"An action takes {1e3 * needed:.3g} ms here, but the behavior's control period is "
            f"{1e3 * controller.control_period:.3g} ms; use a faster machine, or a behavior with a smaller controller."
        )
