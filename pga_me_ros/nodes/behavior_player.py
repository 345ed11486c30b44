"""Behavior player: plays a gait in simulation in real time, for RViz, Foxglove and other nodes."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray, String
from tf2_msgs.msg import TFMessage

from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import RequestError, TaskError
from pga_me_ros.hardware.timing import spread
from pga_me_ros.player.commanded import CommandedEpisode, CommandedJoints, SensorMessages
from pga_me_ros.player.display import require_display
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.messages import RobotMessages, stamp_of
from pga_me_ros.player.model import RobotModel, RobotState
from pga_me_ros.player.pace import Pace
from pga_me_ros.player.promise import average, is_kept, kept, lasted
from pga_me_ros.player.reader import Reader
from pga_me_ros.player.settings import PlayerSettings, require_sense
from pga_me_ros.player.source import Served, Source, Stored
from pga_me_ros.player.urdf import urdf
from pga_me_ros.player.watched_rollout import watched_rollout
from pga_me_ros.player.window import Window, window_of
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.choice import ChoiceSettings, wanted
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare, on_change
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import damage_option, load_task, make_task, randomization_option

TICK = 0.1
"""Seconds between two checks whether to end while waiting for an answer."""


class BehaviorPlayer(GraphNode):
    """One robot in simulation.

    A separate thread plays, so that the node keeps answering.
    """

    def __init__(self) -> None:
        super().__init__("behavior_player")
        self._values = declare(self, ChoiceSettings, PlayerSettings, shared=(Settings, RunOptions))
        self._wanted = wanted(self._values)
        self._mode: str = self._values["commanded"]
        require_sense(self._values)
        if self._values["gui"]:
            require_display()
        self._stop = threading.Event()
        self._pace = Pace(self._values["speed"], self._stop)
        on_change(self, lambda changed: require_sense(self._values | changed), self._change)
        self._clock_topic = self.create_publisher(Clock, names.CLOCK, qos.STREAM)
        self._joint_topic = self.create_publisher(JointState, names.JOINT_STATES, qos.STREAM)
        self._frame_topic = self.create_publisher(TFMessage, names.TF, qos.STREAM)
        self._fixed_topic = self.create_publisher(TFMessage, names.TF_STATIC, qos.LATCHED)
        self._odometry_topic = self.create_publisher(Odometry, names.ODOMETRY, qos.STREAM)
        self._description_topic = self.create_publisher(
            String, names.ROBOT_DESCRIPTION, qos.LATCHED
        )
        self._steps = 0
        self._playing = -1
        self._told: tuple[int, float] | None = None
        self._messages: RobotMessages | None = None
        self._sensors: SensorMessages | None = None
        self._joints: CommandedJoints | None = None
        self._show: Callable[[], None] = lambda: None
        if self._mode != "none":
            self._imu_topic = self.create_publisher(Imu, names.IMU, qos.STREAM)
            self._contact_topic = self.create_publisher(
                Float64MultiArray, names.CONTACTS, qos.STREAM
            )
            self.create_subscription(
                Float64MultiArray, names.COMMANDS, self.unless_ended(self._hear), qos.COMMANDS
            )
        self._window: Window | None = None
        self._player = threading.Thread(target=self._play, name="player")
        # Begins when the executor spins, so that the thread may wait for answers.
        self._begin = self.create_timer(0.0, self._start)

    def _start(self) -> None:
        self._begin.cancel()
        self._player.start()

    def _change(self, changed: dict[str, Any]) -> None:
        self._pace.speed = changed.get("speed", self._pace.speed)

    def _play(self) -> None:
        """Play all episodes; runs in the player's thread."""
        outcome: Exception = ExternalShutdownException()
        try:
            source: Source = (
                Stored(Path(self._values["run_dir"]))
                if self._values["run_dir"]
                else Served(self, self._answer)
            )
            self.start_heartbeat(task=source.task)
            task = self._open_task(source.task, source.settings.randomization)
            try:
                if self._mode != "none":
                    self._joints = CommandedJoints(task)
                    self.get_logger().info(
                        f"waits for efforts of {', '.join(self._joints.joints)} on "
                        f"{self.resolve_topic_name(names.COMMANDS)}"
                    )
                episode = 0
                while episode != (self._values["episodes"] or -1):
                    self._play_episode(source, task, episode)
                    episode += 1
            finally:
                task.close()
        except Exception as error:
            outcome = error
        self.end(outcome)

    def _answer(self, future: Future) -> Any:
        """Wait for a service's answer, or for the node to end.

        Raises:
            ExternalShutdownException: The node should end.
        """
        answered = threading.Event()
        future.add_done_callback(lambda _: answered.set())
        while not answered.wait(TICK):
            self._check_end()
        return future.result()

    def _check_end(self) -> None:
        if self._stop.is_set() or not self.context.ok():
            raise ExternalShutdownException

    def _open_task(self, name: str, randomization: str) -> Task:
        damage = self._values["damage"]
        if not self._values["gui"]:
            return make_task(name, randomization, damage)
        options = randomization_option(name, randomization) | damage_option(name, damage)
        try:
            return load_task(name)(render=True, **options)
        except TypeError as error:
            raise TaskError(
                f"task '{name}' opens no window ({error}); its class takes no argument `render`, so leave gui out"
            ) from error

    def _play_episode(self, source: Source, task: Task, episode: int) -> None:
        gait = source.choose(self._wanted)
        self._tell_of(gait, task)
        period = task.spec.control_period

        def look(step: int, reader: Reader) -> None:
            if not step:
                self._pace.begin()
            elif self._mode != "real_time":  # which waits for the command instead
                self._pace.wait(period)
            self._check_end()
            state = reader.state()
            if self._values["gui"]:
                if self._window is None or not self._window.shows(reader.body):
                    self._window = window_of(reader, state)
                self._window.follow(state)
            self._show = partial(self._publish, reader.model, state, task)
            self._show()

        fresh = self._values["start"] == "fresh"
        s, k = source.settings, gait.evaluation
        if fresh:  # a pose of no evaluation of the run
            act, rng = gait.controller, evaluation_rng(s.seed + 1, episode)
        else:
            act, rng = as_evaluated(s, gait.controller, k), evaluation_rng(s.seed, k)
        if self._joints:
            act = CommandedEpisode(
                self._joints,
                self._pace,
                period,
                lock_step=self._mode == "lock_step",
                hold_steps=math.ceil(self._values["hold"] / period),
                show=lambda: self._show(),
                check=self._check_end,
            )
        done = watched_rollout(task, act, rng, look)
        self.count_done()
        factor = done.length * period / max(self._pace.elapsed(), 1e-9)
        text = (
            f"episode {episode + 1}: {kept(gait, done, fresh=fresh)}; {lasted(done, period)} at {factor:.2f} x real "
            "time"
        )
        if self._joints and self._joints.delays:
            text += (
                f"; commands came {spread(self._joints.delays)} ms after the sensors (median, 99 %)"
            )
            self._joints.delays.clear()
        if (told := (gait.evaluation, done.fitness)) == self._told:
            return  # the same once more
        self._told = told
        if not fresh and self._values["episodes"] == 0 and "random" not in self._wanted:
            text += "; repeated until Ctrl-C"
        # Where solutions are evaluated again, what is stored are means of several evaluations.
        own = not (s.extracted or self._values["damage"] or self._joints)
        if fresh or is_kept(gait, done) or not own:
            self.get_logger().info(text)
        else:
            self.get_logger().warning(
                f"{text}; the repertoire comes from other libraries or another kind of machine"
            )

    def _hear(self, msg: Float64MultiArray) -> None:
        """Hand a command to the player's thread."""
        if self._joints is None:
            return
        try:
            self._joints.put(msg.data)
        except RequestError as error:
            self.refused(str(error))

    def _tell_of(self, gait: Gait, task: Task) -> None:
        """Say which gait is played, unless it is the one of the last episode."""
        if gait.evaluation == self._playing:
            return
        self._playing = gait.evaluation
        numbers = ", ".join(f"{x:.3f}" for x in gait.promised_descriptor)
        asked = "descriptor" in self._wanted
        self.get_logger().info(
            f"{task.spec.name}: playing cell {gait.cell}, descriptor [{numbers}]"
            + (f", {gait.distance:.3f} from the wanted one" if asked else "")
            + (f"; {average(gait)}" if gait.by_mean else "")
        )

    def _publish(self, model: RobotModel, state: RobotState, task: Task) -> None:
        """Publish the robot's present state."""
        nanoseconds = round(1e9 * task.spec.control_period * self._steps)
        self._steps += 1
        if self._values["clock"]:
            stamp = stamp_of(nanoseconds)
            self._clock_topic.publish(Clock(clock=stamp))
        else:
            stamp = self.get_clock().now().to_msg()
        if self._messages is None:
            self._messages = RobotMessages(model, self._values["frame_prefix"])
            self._description_topic.publish(String(data=urdf(model)))
            self._fixed_topic.publish(self._messages.fixed_frames(stamp))
        self._frame_topic.publish(self._messages.moving_frames(state, stamp))
        self._joint_topic.publish(self._messages.joint_state(state, stamp))
        if not self._joints:
            self._odometry_topic.publish(self._messages.odometry(state, stamp))
            return
        told = state.as_told()  # what the behavior knew of when it was evaluated
        self._odometry_topic.publish(self._messages.odometry(told, stamp))
        if self._sensors is None:
            self._sensors = SensorMessages(model, self._values["frame_prefix"])
        self._imu_topic.publish(self._sensors.imu(told, stamp))
        contacts = self._sensors.contacts(task)
        if contacts is not None:
            self._contact_topic.publish(contacts)
        self._joints.shown = time.monotonic()

    def destroy_node(self) -> None:
        """Stop playing, then destroy the node."""
        self._stop.set()
        if self._player.is_alive():
            self._player.join()
        super().destroy_node()


PROGRAM = Program(
    "behavior_player",
    "Plays a gait of a repertoire in simulation: /joint_states, /tf, /odom, /clock and /robot_description.",
    (ChoiceSettings, PlayerSettings),
)


def main() -> int:
    """Run the behavior player."""
    return run_node(PROGRAM, BehaviorPlayer)


if __name__ == "__main__":
    raise SystemExit(main())
