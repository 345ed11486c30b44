"""The simulated robot as hardware: it publishes what its sensors say, and its joints follow the efforts of a topic."""

from __future__ import annotations

import array
import math
import queue
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64MultiArray

from pga_me_ros.arrays import Float32Array
from pga_me_ros.errors import RequestError, TaskError
from pga_me_ros.player.messages import in_base
from pga_me_ros.player.model import RobotModel, RobotState
from pga_me_ros.player.pace import Pace
from pga_me_ros.player.reader import body_of
from pga_me_ros.tasks.protocol import Task

SILENCE = 0.05
"""Seconds without a command after which none is on its way any more."""

AGAIN = 0.5
"""Seconds without a command after which the sensors say the same once more: a controller may have come too late."""


class Command(NamedTuple):
    """Efforts that came."""

    efforts: tuple[float, ...]
    at: float


class CommandedJoints:
    """Joints that follow a topic. One thread puts commands in, another one takes them.

    Args:
        task: The task; it must have a `body` with the efforts of its joints, and actions NAME/torque.

    Attributes:
        shown: When the sensors spoke last.
        delays: Seconds from each reading of the sensors to the command that answered it, in lock step.

    Raises:
        TaskError: The task's robot cannot be commanded.
    """

    def __init__(self, task: Task) -> None:
        efforts = body_of(task).efforts
        joints = [name.removesuffix("/torque") for name in task.spec.action_names]
        lacking = [joint for joint in joints if joint not in efforts]
        if lacking:
            raise TaskError(
                f"task '{task.spec.name}' cannot be commanded: its body has no effort for {', '.join(lacking)}, which "
                "an action of 1 stands for; see docs/tasks.md"
            )
        self.joints = tuple(joints)
        self._efforts = np.array([efforts[joint] for joint in joints])
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._newest: Command | None = None
        self.shown = 0.0
        self.delays: list[float] = []

    def put(self, efforts: Any) -> None:
        """Take a command that has come.

        Raises:
            RequestError: It has the wrong length, or a number that is not finite.
        """
        if len(efforts) != len(self.joints) or not all(map(math.isfinite, efforts)):
            raise RequestError(
                f"a command is {list(efforts)}; expected {len(self.joints)} finite efforts: {', '.join(self.joints)}"
            )
        self._commands.put(Command(tuple(efforts), time.monotonic()))

    def first(self, show: Callable[[], None], check: Callable[[], None]) -> None:
        """Wait until somebody commands the joints, then until no command is on its way any more.

        Args:
            show: Publishes what the sensors say.
            check: Raises when the wait should end.
        """
        while self._wait(AGAIN, check) is None:
            show()
        deadline = time.monotonic() + AGAIN  # who commands by a clock is never silent
        while time.monotonic() < deadline and self._wait(SILENCE, check) is not None:
            pass

    def answer(self, show: Callable[[], None], check: Callable[[], None]) -> Float32Array:
        """Wait for the next command, and return it as an action; arguments as in `first`.

        If the sensors spoke more than once, whoever is slow answers each time: all answers but the first are left out,
        so that they are not taken for those to the next reading.
        """
        shown, again = self.shown, 0
        while (command := self._wait(AGAIN, check)) is None:
            show()
            again += 1
        self.delays.append(command.at - shown)
        while again and self._wait(AGAIN, check):
            again -= 1
        return self._action(command)

    def newest(self) -> Float32Array | None:
        """Return the newest command as an action; the joints keep to it until another comes. None before the first."""
        while not self._commands.empty():
            self._newest = self._commands.get()
        return None if self._newest is None else self._action(self._newest)

    def _wait(self, seconds: float, check: Callable[[], None]) -> Command | None:
        check()
        try:
            self._newest = self._commands.get(timeout=seconds)
        except queue.Empty:
            return None
        return self._newest

    def _action(self, command: Command) -> Float32Array:
        return (np.array(command.efforts) / self._efforts).astype(np.float32)


class CommandedEpisode:
    """Acts in place of a gait in one episode: whoever commands the joints.

    Args:
        joints: The joints.
        pace: Real time, or a multiple of it.
        period: Control period, s.
        lock_step: Whether each step waits for its command; otherwise the newest one counts when a period is over.
        hold_steps: Periods for which the robot is held in its initial pose while it is commanded.
        show: Publishes what the sensors say.
        check: Raises when a wait should end.
    """

    def __init__(
        self,
        joints: CommandedJoints,
        pace: Pace,
        period: float,
        *,
        lock_step: bool,
        hold_steps: int,
        show: Callable[[], None],
        check: Callable[[], None],
    ) -> None:
        self._joints = joints
        self._pace = pace
        self._period = period
        self._lock_step = lock_step
        self._hold_steps = hold_steps
        self._show = show
        self._check = check
        self._held = False

    def __call__(self, _: Float32Array) -> Float32Array:
        """Return the action for the step that comes next."""
        if not self._held:
            self._held = True
            self._hold()
            self._pace.begin()
        return self._action()

    def _hold(self) -> None:
        """Keep the robot where it is, until somebody commands it and has had time to ramp in."""
        if self._lock_step:
            self._joints.first(self._show, self._check)
            self._show()
        for _ in range(self._hold_steps):
            self._action()
            if self._lock_step:
                self._pace.wait(self._period)
            self._show()
        self._joints.delays.clear()

    def _action(self) -> Float32Array:
        if self._lock_step:
            return self._joints.answer(self._show, self._check)
        while True:
            self._pace.wait(self._period)
            self._check()
            action = self._joints.newest()
            if action is not None:
                return action
            self._show()


class SensorMessages:
    """Makes the messages that a real robot's sensors send besides joint states and odometry.

    Args:
        model: The robot.
        prefix: Prefix of frame names.
    """

    def __init__(self, model: RobotModel, prefix: str = "") -> None:
        self._imu = Imu()
        self._imu.header.frame_id = prefix + model.base
        self._imu.linear_acceleration_covariance[0] = -1.0  # there is no such sensor
        self._contacts = Float64MultiArray()

    def imu(self, state: RobotState, stamp: Time) -> Imu:
        """Return orientation and angular velocity of the base."""
        msg, q = self._imu, self._imu.orientation
        msg.header.stamp = stamp
        q.x, q.y, q.z, q.w = state.base.rotation
        v = msg.angular_velocity
        v.x, v.y, v.z = in_base(state, state.angular)
        return msg

    def contacts(self, task: Any) -> Float64MultiArray | None:
        """Return 1 for each link that touches the floor, else 0, in the order of the observation; None if unknown."""
        told = getattr(task, "contacts", None)
        if told is None:
            return None
        self._contacts.data = array.array("d", map(float, told()))
        return self._contacts
