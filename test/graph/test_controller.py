"""A behavior on the joints of the simulated robot: over topics, between processes, and with sensors that fail."""

from __future__ import annotations

import math
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
from graph import Graph, Probe, Started, ros_arguments, wait_until
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.nodes.controller import PROGRAM, JointController
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import rollout

REPERTOIRE = "zoo/qd_hopper"
MAPPING = Path(__file__).resolve().parents[2] / "config" / "hardware" / "qd_hopper.yaml"
JOINTS = ["thigh_joint", "leg_joint", "foot_joint"]

# A second controller in another namespace, which hears the same sensors.
REMAPPED = ["-r", "__ns:=/other"]
for topic in (names.JOINT_STATES, names.ODOMETRY, names.IMU, names.CONTACTS):
    REMAPPED += ["-r", f"{topic}:=/{topic}"]


def test_the_loop_closed_over_topics_gives_the_gait_that_was_promised(
    graph: Graph, probe: Probe
) -> None:
    run = StoredRun.load(REPERTOIRE)
    gait = run.choose(descriptor=[0.7])
    task = make_task("qd_hopper")
    start = evaluation_rng(run.settings.seed, gait.evaluation)
    alone = rollout(task, gait.controller, start)
    task.close()
    commands = probe.listen(Float64MultiArray, names.COMMANDS, qos.STREAM)
    asked = {"descriptor": [0.7]}
    # The guard takes part: while the robot is held, efforts ramp in.
    player = graph.start(
        "behavior_player",
        {
            **asked,
            "run_dir": REPERTOIRE,
            "commanded": "lock_step",
            "hold": 0.3,
            "speed": 0.0,
            "episodes": 1,
        },
    )
    controller = graph.start(
        "controller",
        {
            **asked,
            "repertoire": REPERTOIRE,
            "mapping": MAPPING,
            "trigger": "contacts",
            "simulated": True,
            "ramp": 0.2,
            "timeout": 30.0,
        },
    )
    assert player.wait() == 0, player.output + controller.output
    line = re.search(r"achieved fitness ([\d.]+), .* promised fitness ([\d.]+),", player.output)
    assert line, player.output
    achieved, promised = map(float, line.groups())
    assert achieved == pytest.approx(promised, rel=0.05)
    assert achieved == pytest.approx(alone.fitness, abs=0.005)  # not only about the same
    assert re.search(r"commands came [\d.]+, [\d.]+ ms after the sensors", player.output)
    controller.signal(signal.SIGHUP)  # as of a terminal that is closed
    assert controller.wait() == 0, controller.output
    assert "stopped: the controller ends" in controller.output
    assert re.search(r" 10\d\d commands; latency median, 99 %, most", controller.output)
    wait_until(lambda: list(commands[-1].data) == [0.0] * 3, "efforts of 0 as the last word")
    assert all(math.isfinite(x) and abs(x) <= 75.0 for msg in commands for x in msg.data)


@dataclass
class Driven:
    """A controller that drives by a clock, and a robot of messages."""

    controller: Started
    probe: Probe
    commands: list[Float64MultiArray]
    diagnostics: list[DiagnosticArray]
    speak: Callable[..., None]

    def stop(self, on: bool) -> str:
        """Call the emergency stop or release it; return the state that it answers."""
        answer = self.probe.call(SetBool, "controller/emergency_stop", data=on)
        assert answer.success
        return str(answer.message)

    def next_commands(self, count: int = 20) -> list[list[float]]:
        """Let the sensors speak until some more commands have come, and return those."""
        self.commands.clear()

        def came() -> bool:
            self.speak()
            return len(self.commands) >= count

        wait_until(came, "commands")
        return [list(msg.data) for msg in self.commands]

    def moves_after_release(self) -> bool:
        """Release it, also from a freeze as of a busy machine, while the sensors speak; return whether joints move."""
        self.next_commands()
        self.stop(on=False)
        return self.moves()

    def moves(self) -> bool:
        """Whether the newest of the next commands has an effort that is not 0."""
        return any(self.next_commands()[-1])

    def exit_code(self, other: Started) -> int:
        """Let the sensors speak until another process has ended; return its exit code."""

        def ended() -> bool:
            self.speak()
            return other.process.poll() is not None

        wait_until(ended, "its end")
        return other.wait()

    def told(self, words: str) -> None:
        """Wait until the diagnostics say something."""

        def said() -> bool:
            return any(words in s.message for m in self.diagnostics for s in m.status)

        wait_until(said, f"{words!r} in /diagnostics")


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driven]:
    folder = tmp_path_factory.mktemp("driven")
    with pytest.MonkeyPatch.context() as patch, domain_id() as domain:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph, probe = Graph(domain, folder), Probe(domain)
        parameters = {"repertoire": REPERTOIRE, "mapping": MAPPING, "timeout": 2.0, "ramp": 0.05}
        controller = graph.start("controller", parameters)
        node = probe.node
        topics = [
            (node.create_publisher(kind, name, qos.STREAM), message)
            for kind, name, message in (
                (Odometry, names.ODOMETRY, Odometry()),
                (Imu, names.IMU, Imu()),
                (Float64MultiArray, names.CONTACTS, Float64MultiArray(data=[0.0])),
                (JointState, names.JOINT_STATES, None),
            )
        ]

        def speak(velocity: float = 0.0) -> None:
            joints = JointState(name=JOINTS, position=[0.0] * 3, velocity=[0.0, 0.0, velocity])
            for topic, message in topics:
                topic.publish(message or joints)

        yield Driven(
            controller,
            probe,
            probe.listen(Float64MultiArray, names.COMMANDS, qos.STREAM),
            probe.listen(DiagnosticArray, names.DIAGNOSTICS, qos.DIAGNOSTICS),
            speak,
        )
        probe.close()
        graph.kill()


def test_it_waits_for_sensors_and_commands_once_all_have_spoken(driven: Driven) -> None:
    driven.controller.wait_for_output("waiting for sensors")
    assert not driven.commands
    assert driven.moves()
    driven.controller.wait_for_output("running")


def test_an_emergency_stop_lasts_until_it_is_released(driven: Driven) -> None:
    assert driven.moves_after_release()
    assert driven.stop(on=True) == "stopped"
    assert not any(map(any, driven.next_commands()[1:]))  # the first one may be of before
    driven.told("stopped: emergency stop")
    assert driven.stop(on=False) == "waiting for sensors"
    assert driven.moves()


def test_nan_in_a_sensor_reaches_no_joint_and_freezes_if_it_lasts(driven: Driven) -> None:
    assert driven.moves_after_release()
    driven.commands.clear()
    before = driven.controller.output.count("frozen: ")

    def frozen() -> bool:
        driven.speak(velocity=math.nan)
        return driven.controller.output.count("frozen: ") > before

    wait_until(frozen, "a freeze")
    assert "velocity of foot_joint on topic 'joint_states' is nan" in driven.controller.output
    assert all(math.isfinite(x) for msg in driven.commands for x in msg.data)
    assert not driven.moves()  # the sensors speak sense again, but nobody released it
    driven.stop(on=False)
    assert driven.moves()


def test_a_release_while_the_sensors_are_silent_keeps_the_joints_safe(driven: Driven) -> None:
    assert driven.moves_after_release()
    wait_until(lambda: not any(driven.commands[-1].data), "a freeze")  # nobody speaks
    driven.diagnostics.clear()
    driven.stop(on=False)
    count = len(driven.commands)
    wait_until(lambda: len(driven.commands) > count + 5, "commands of a freeze")
    assert not any(any(msg.data) for msg in driven.commands[count:])
    driven.told("frozen: ")
    assert driven.moves_after_release()


def test_a_second_controller_leaves_before_it_commands(driven: Driven, tmp_path: Path) -> None:
    graph = Graph(driven.probe.context.get_domain_id(), tmp_path)
    commands = driven.probe.listen(Float64MultiArray, "second_commands", qos.STREAM)
    parameters = {"repertoire": REPERTOIRE, "mapping": MAPPING, "timeout": 5.0}
    second = graph.start("controller", parameters, "-r", "commands:=second_commands")
    assert driven.exit_code(second) == 2
    assert "is taken in this ROS domain" in second.output
    assert not commands


def test_a_controller_that_stood_still_freezes(driven: Driven) -> None:
    assert driven.moves_after_release()
    begun = driven.controller.output.count("the controller stood still")
    driven.controller.signal(signal.SIGSTOP)
    pause = time.monotonic() + 4.0  # twice its timeout

    def slept() -> bool:
        driven.speak()
        return time.monotonic() > pause

    wait_until(slept, "a stall")
    driven.controller.signal(signal.SIGCONT)
    wait_until(
        lambda: driven.controller.output.count("the controller stood still") > begun, "a freeze"
    )
    assert not driven.moves()
    assert driven.moves_after_release()


def test_a_joint_that_the_robot_has_not_ends_it_in_one_line(driven: Driven, tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(MAPPING.read_text().replace("joint: foot_joint", "joint: ankle_joint"))
    parameters = {"repertoire": REPERTOIRE, "mapping": mapping}
    graph = Graph(driven.probe.context.get_domain_id(), tmp_path)
    other = graph.start("controller", parameters, *REMAPPED)
    assert driven.exit_code(other) == 2
    words = "error: Topic 'joint_states' has no joint 'ankle_joint' (did you mean 'leg_joint'?); it has thigh_joint,"
    assert other.output.splitlines()[-1].startswith(words)


FAULT = """
from pga_me_ros.hardware.control_loop import ControlLoop
from pga_me_ros.nodes.controller import main

step, steps = ControlLoop.step, iter(range(30))

def until_the_fault(loop, now):
    next(steps)
    return step(loop, now)

ControlLoop.step = until_the_fault
raise SystemExit(main())
"""


def test_a_fault_of_the_controller_leaves_the_joints_without_effort(
    driven: Driven, tmp_path: Path
) -> None:
    commands = driven.probe.listen(Float64MultiArray, "/other/commands", qos.STREAM)
    parameters = {"repertoire": REPERTOIRE, "mapping": MAPPING, "timeout": 5.0, "ramp": 0.0}
    graph = Graph(driven.probe.context.get_domain_id(), tmp_path)
    command = [sys.executable, "-c", FAULT, *ros_arguments(parameters), *REMAPPED]
    faulty = graph.launch(command)
    assert driven.exit_code(faulty) == 1
    assert "StopIteration" in faulty.output
    wait_until(lambda: bool(commands) and not any(commands[-1].data), "efforts of 0")
    assert any(map(any, (msg.data for msg in commands)))


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({}, "No mapping is given; -p mapping:=FILE says which sensors and joints there are"),
        ({"mapping": "none.yaml"}, "There is no mapping 'none.yaml'"),
        ({"mapping": MAPPING, "repertoire": "zoo/qd_hoper"}, "(did you mean 'zoo/qd_hopper'?)"),
        ({"mapping": MAPPING, "select": "cell"}, "select is 'cell', but no cell is given"),
        ({"mapping": MAPPING, "frozen": "hol"}, "frozen is 'hol' (did you mean 'hold'?)"),
    ],
    ids=lambda case: next(iter(reversed(case)), "none") if isinstance(case, dict) else "",
)
def test_bad_parameters(
    parameters: dict[str, Any],
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with domain_id() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        assert run_node(PROGRAM, JointController, ros_arguments(parameters)) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert words in said
