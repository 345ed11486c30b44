"""Controller: runs a behavior of a repertoire on the joints of a robot."""

from __future__ import annotations

import array
import math
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from pga_me_ros.arrays import Float64Array
from pga_me_ros.client import Behavior, RepertoireClient
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import SettingsError
from pga_me_ros.hardware.control_loop import ControlLoop
from pga_me_ros.hardware.fields import TYPES, UnusableError
from pga_me_ros.hardware.mapping import RobotMapping
from pga_me_ros.hardware.mapping_file import read_mapping
from pga_me_ros.hardware.observer import SensorError
from pga_me_ros.hardware.settings import HardwareSettings
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.choice import ChoiceSettings, wanted
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.namesakes import STOP_OR_MOVE, leave_to_elders
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import run_node

CHECKS_PER_TIMEOUT = 4
"""How often stale sensors are looked for within the shortest timeout, when a sensor triggers the commands."""

LONGEST_PAUSE = 0.1
"""Maximum seconds between two looks, whatever the timeouts: a timer lets Python notice signals, too."""

ALONE = 2.0
"""Seconds without another controller of the name after which this one commands: heartbeats come once a second."""

LAST_WORDS = Duration(nanoseconds=300_000_000)
"""How long to wait at the end until the last command has arrived."""


class JointController(GraphNode):
    """One behavior on one robot. All of it runs in the executor's thread, so that nothing can come in between."""

    def __init__(self) -> None:
        super().__init__("controller")
        self._awake = math.inf
        self._loop: ControlLoop | None = None
        values = declare(self, ChoiceSettings, HardwareSettings, shared=(Settings, RunOptions))
        choice = wanted(values)
        if not values["mapping"]:
            raise SettingsError(
                "No mapping is given; -p mapping:=FILE says which sensors and joints there are, for example "
                "config/hardware/qd_hopper.yaml."
            )
        mapping = read_mapping(Path(values["mapping"]))
        behavior = self._ask(choice, values["repertoire"])
        self._loop = loop = ControlLoop(mapping, behavior.controller, values)
        self._state = loop.guard.state
        self._command = Float64MultiArray()
        self._topic = self.create_publisher(Float64MultiArray, mapping.topic, qos.COMMANDS)
        self.create_service(SetBool, names.EMERGENCY_STOP, self.unless_ended(self._stop))
        trigger = values["trigger"]
        self._listen(mapping, loop, trigger)
        # A steady clock: wall clocks may jump, and simulated ones stand still.
        pause = min(loop.shortest_timeout / CHECKS_PER_TIMEOUT, LONGEST_PAUSE)
        self._pause, beat = (pause, self._check) if trigger else (loop.period, self._step)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self._pause, self.unless_ended(beat), clock=steady)
        leave_to_elders(self, lambda msg: msg.kind == "controller", STOP_OR_MOVE)
        self._silent_until = time.monotonic() + ALONE
        self.start_heartbeat(task=behavior.controller.task)
        numbers = ", ".join(f"{x:.3f}" for x in behavior.promised_descriptor)
        self.get_logger().info(
            f"{behavior.controller.task}: runs cell {behavior.cell}, descriptor [{numbers}], promised fitness "
            f"{behavior.promised_fitness:.2f}; {len(mapping.joints)} joints on {self._topic.topic_name} every "
            f"{1e3 * loop.period:.4g} ms; {loop.guard.state}"
        )

    def _ask(self, choice: Mapping[str, Any], repertoire: str) -> Behavior:
        """Return the wanted behavior.

        Raises:
            PgaError: No repertoire is served, or none of its behaviors fits.
        """
        client = RepertoireClient(self, repertoire=repertoire)
        try:
            return client.get_behavior(**choice)
        finally:
            client.close()

    def _listen(self, mapping: RobotMapping, loop: ControlLoop, trigger: str) -> None:
        for name in loop.observer.sources:
            source = mapping.sources[name]
            profile = qos.STREAM if source.reliable else qos.SENSORS
            take = self.unless_ended(partial(self._take, loop, name, name == trigger))
            self.create_subscription(TYPES[source.type], source.topic, take, profile)

    def _take(self, loop: ControlLoop, source: str, triggers: bool, msg: Any) -> None:
        now = time.monotonic()
        try:
            loop.observer.take(source, msg, now)
        except UnusableError as error:
            self.refused(str(error))
        except SensorError as error:
            if loop.guard.has_commanded:
                self.refused(str(error))
            else:  # the mapping is wrong
                self.end(error)
        if triggers and loop.due(now):
            self._step()

    def _check(self) -> None:
        """Look for stale sensors, as there may be no more message that triggers."""
        loop, now = self._loop, time.monotonic()
        assert loop is not None
        missing = self._stall(loop, now) or loop.missing(now)
        if missing:
            self._publish(loop.guard.freeze(missing))

    def _step(self) -> None:
        """Give the command of a control period."""
        loop, now = self._loop, time.monotonic()
        assert loop is not None
        if now < self._silent_until:
            return
        stall = self._stall(loop, now)
        self._publish(loop.guard.freeze(stall) if stall else loop.step(now))

    def _stall(self, loop: ControlLoop, now: float) -> str:
        """Return for how long this process did nothing, in words, if it was too long; else empty.

        What it then finds in its queues is old, though it comes just now.
        """
        since, self._awake = now - self._awake, now
        late = since - self._pause > loop.shortest_timeout
        return f"the controller stood still for {since:.2f} s" if late else ""

    def _publish(self, command: Float64Array | None) -> None:
        loop = self._loop
        assert loop is not None
        if command is not None:
            self._command.data = array.array("d", command.tobytes())
            self._topic.publish(self._command)
            loop.sent(time.monotonic())
            self.count_done()
        if loop.guard.state is not self._state:
            self._state = loop.guard.state
            words = f"{self._state}: {loop.guard.reason}" if loop.guard.reason else self._state
            if loop.guard.reason:
                self.get_logger().warning(words)
            else:
                self.get_logger().info(words)

    def _stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        assert self._loop is not None
        guard = self._loop.guard
        if request.data:
            self._publish(guard.stop("emergency stop"))
        else:
            guard.release()
            self._publish(None)
        response.success, response.message = True, str(guard.state)
        return response

    def health(self) -> Mapping[str, object]:
        """Return state, latency and jitter for /diagnostics; a freeze or stop is an error for as long as it lasts."""
        loop = self._loop
        if loop is None:
            return {}
        if loop.guard.reason:
            self.diagnostics.fault(f"{loop.guard.state}: {loop.guard.reason}")
        return {"state": str(loop.guard.state), **loop.timing.values()}

    def destroy_node(self) -> None:
        """Leave the joints with a safe command, say how punctual the commands were, then destroy the node."""
        loop = self._loop
        if loop is not None and self.context.ok():
            if loop.guard.has_commanded:  # what was never commanded is left alone
                self._publish(loop.guard.stop("the controller ends"))
                self._topic.wait_for_all_acked(LAST_WORDS)
            if loop.timing.count:
                self.get_logger().info(loop.timing.summary())
        super().destroy_node()


PROGRAM = Program(
    "controller",
    "Runs a behavior of a repertoire on a robot: sensor messages in, commands for its joints out.",
    (ChoiceSettings, HardwareSettings),
)


def main() -> int:
    """Run the controller."""
    return run_node(PROGRAM, JointController, last_words=True)


if __name__ == "__main__":
    raise SystemExit(main())
