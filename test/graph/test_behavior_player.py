"""The player as a process; its messages are compared with PyBullet's data of the same episode in this process."""

from __future__ import annotations

import signal
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pytest
from graph import Graph, Probe, wait_until
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from stored import SETTINGS, SHAPE, SPEC, Served
from tf2_msgs.msg import TFMessage

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.player.transform import Transform
from pga_me_ros.ros import qos
from pga_me_ros.tasks.registry import make_task

SPEED = 2.0


@dataclass
class Truth:
    """PyBullet's data after each step of an episode, including the start.

    Attributes:
        joints: Position and velocity of the actuated joints.
        links: Pose of each link's center of mass in the world.
        velocity: Linear and angular velocity of the torso in the world.
    """

    joints: list[np.ndarray] = field(default_factory=list)
    links: list[dict[str, Transform]] = field(default_factory=list)
    velocity: list[np.ndarray] = field(default_factory=list)

    @classmethod
    def of(cls, parameters: np.ndarray, evaluation: int) -> Truth:
        """Run an episode and read PyBullet's data after each step."""
        task: Any = make_task("qd_walker")
        controller, truth = MlpController(SHAPE, parameters), cls()
        observation = task.reset(evaluation_rng(SETTINGS.seed, evaluation))
        ended = False
        while not ended:
            truth._look(task.body.client, task.body.robot)
            observation, _, ended = task.step(controller(observation))
        truth._look(task.body.client, task.body.robot)
        task.close()
        return truth

    def _look(self, client: int, robot: int) -> None:
        count = pybullet.getNumJoints(robot, client)
        infos = [pybullet.getJointInfo(robot, i, client) for i in range(count)]
        names = [name.removesuffix("/torque") for name in SPEC.action_names]
        joints = [info[0] for info in infos if info[1].decode() in names]
        states = pybullet.getJointStates(robot, joints, client)
        self.joints.append(np.array([state[:2] for state in states]))
        states = pybullet.getLinkStates(robot, range(count), 1, 0, client)
        torso = next(i for i, info in enumerate(infos) if info[12] == b"torso")
        self.velocity.append(np.array(states[torso][6:8]))
        states = pybullet.getLinkStates(robot, range(count), 0, 1, client)
        self.links.append(
            {info[12].decode(): Transform(*s[:2]) for info, s in zip(infos, states, strict=True)}
        )


@dataclass
class Heard:
    """Messages of a player, each topic in order."""

    clock: list[Clock]
    joints: list[JointState]
    frames: list[TFMessage]
    odometry: list[Odometry]
    fixed: list[TFMessage]
    description: list[String]
    truth: Truth
    output: str
    code: int

    def step(self, msg: Any) -> int:
        """Return the number of steps of the episode before a message was sent."""
        seconds = msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec
        return round(seconds / SPEC.control_period) % len(self.truth.joints)


@pytest.fixture(scope="module")
def heard(repertoire: Served) -> Heard:
    """Record a player until it has played a whole episode, then interrupt it."""
    best = repertoire.archive.best()
    truth = Truth.of(best.parameters, best.evaluation)
    listen = repertoire.probe.listen
    heard = Heard(
        clock=listen(Clock, "/clock", qos.STREAM),
        joints=listen(JointState, "joint_states", qos.STREAM),
        frames=listen(TFMessage, "/tf", qos.STREAM),
        odometry=listen(Odometry, "odom", qos.STREAM),
        fixed=listen(TFMessage, "/tf_static", qos.LATCHED),
        description=listen(String, "robot_description", qos.LATCHED),
        truth=truth,
        output="",
        code=-1,
    )
    descriptor = [float(x) for x in best.descriptor]
    player = repertoire.graph.start("behavior_player", {"descriptor": descriptor, "speed": SPEED})

    def enough() -> bool:
        assert player.process.poll() is None, player.output
        return min(map(len, (heard.joints, heard.frames, heard.odometry))) >= len(truth.joints)

    wait_until(enough, "an episode")
    wait_until(lambda: len(heard.joints) > 2 * len(truth.joints), "the same once more")
    wait_until(lambda: bool(heard.fixed and heard.description), "the robot's description")
    player.wait_for_output("equal")
    player.signal(signal.SIGINT)
    heard.code, heard.output = player.wait(), player.output
    return heard


def test_joint_states_equal_pybullets(heard: Heard) -> None:
    names = [name.removesuffix("/torque") for name in SPEC.action_names]
    for msg in heard.joints:
        expected = heard.truth.joints[heard.step(msg)]
        assert list(msg.name) == names
        assert np.abs(np.array(msg.position) - expected[:, 0]).max() < 1e-9
        assert np.abs(np.array(msg.velocity) - expected[:, 1]).max() < 1e-9


def test_frames_give_the_poses_of_pybullets_links(heard: Heard) -> None:
    centers = centers_of_mass(heard.description[0].data)
    assert set(centers) == {link for link in heard.truth.links[0] if not link.startswith("link0_")}
    for msg in heard.frames:
        poses = poses_in_world([msg, heard.fixed[0]])
        expected = heard.truth.links[heard.step(msg.transforms[0])]
        for link, center in centers.items():
            assert distance(poses[link] @ center, expected[link]) < 1e-9, link


def test_odometry_is_the_pose_of_the_base_and_its_velocity_in_its_own_axes(heard: Heard) -> None:
    for msg in heard.odometry:
        step = heard.step(msg)
        torso = heard.truth.links[step]["torso"]
        pose = pose_of(msg.pose.pose.position, msg.pose.pose.orientation)
        assert distance(pose, torso) < 1e-9
        matrix = np.array(pybullet.getMatrixFromQuaternion(torso.rotation)).reshape(3, 3)
        twist = msg.twist.twist
        told = [[v.x, v.y, v.z] for v in (twist.linear, twist.angular)]
        assert np.abs(np.array(told) - heard.truth.velocity[step] @ matrix).max() < 1e-9
    assert (msg.header.frame_id, msg.child_frame_id) == ("odom", "base_link")


def test_the_clock_goes_forward_by_control_periods(heard: Heard) -> None:
    times = np.array([msg.clock.sec * 10**9 + msg.clock.nanosec for msg in heard.clock])
    periods = np.diff(times) / (1e9 * SPEC.control_period)
    assert len(periods) > 10
    assert periods == pytest.approx(np.ones(len(periods)), abs=1e-6)


def test_the_achieved_result_is_printed_next_to_the_promised_one(heard: Heard) -> None:
    line = next(line for line in heard.output.splitlines() if "episode 1:" in line)
    assert "achieved fitness" in line
    assert "promised fitness" in line
    seconds = (len(heard.truth.joints) - 1) * SPEC.control_period
    assert f": equal; fell after {seconds:.1f} s at " in line
    assert line.endswith("; repeated until Ctrl-C")
    assert heard.code == 0
    assert "Traceback" not in heard.output


def test_with_a_file_it_needs_no_other_node_and_ends_by_itself(
    repertoire: Served, tmp_path: Path
) -> None:
    graph = Graph(repertoire.graph.domain, tmp_path)
    cell = int(repertoire.archive.filled_cells()[0])
    player = graph.start(
        "behavior_player", {"run_dir": repertoire.path, "cell": cell, "speed": 0.0, "episodes": 2}
    )
    assert player.wait() == 0, player.output
    assert f"playing cell {cell}," in player.output
    assert player.output.count(": equal;") == 1


def test_a_damaged_robot_is_played_and_a_damage_it_cannot_have_is_refused(
    repertoire: Served, tmp_path: Path
) -> None:
    graph = Graph(repertoire.graph.domain, tmp_path)
    asked = {"run_dir": repertoire.path, "speed": 0.0, "select": "best", "episodes": 1}
    player = graph.start("behavior_player", asked | {"damage": "free leg_joint, free thigh_joint"})
    assert player.wait() == 0, player.output
    assert player.output.count(": different;") == 1
    player = graph.start("behavior_player", asked | {"damage": "free hip_1"})
    assert player.wait() == 2
    assert "damage names the joint 'hip_1', which qd_walker has not" in player.output
    assert "Traceback" not in player.output


def test_what_is_refused_at_the_start_is_refused_while_it_runs(graph: Graph, probe: Probe) -> None:
    graph.start("behavior_player", {"run_dir": "zoo/qd_hopper", "commanded": "real_time"})
    standstill = Parameter("speed", value=0.0).to_parameter_msg()
    answer = probe.call(SetParameters, "behavior_player/set_parameters", parameters=[standstill])
    assert not answer.results[0].successful
    assert answer.results[0].reason.endswith("but speed is 0; give a speed above 0.")


def test_without_a_display_a_window_is_refused_in_one_line(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    player = graph.start("behavior_player", {"gui": True})
    assert player.wait() == 2
    assert "There is no display for a window" in player.output
    assert "Traceback" not in player.output


def centers_of_mass(description: str) -> dict[str, Transform]:
    """Return the center of mass of each link that has one, in its frame; the models do not rotate inertial frames."""
    found = {}
    for link in ET.fromstring(description).iter("link"):
        origin = link.find("inertial/origin")
        if origin is not None:
            assert origin.get("rpy") == "0.0 0.0 0.0"
            x, y, z = (float(word) for word in origin.get("xyz", "").split())
            found[link.get("name", "")] = Transform((x, y, z))
    return found


def poses_in_world(messages: list[TFMessage]) -> dict[str, Transform]:
    """Return the pose of every frame as computed by a subscriber of /tf and /tf_static."""
    edges = {t.child_frame_id: t for msg in messages for t in msg.transforms}

    def pose(frame: str) -> Transform:
        if frame == "odom":
            return Transform()
        edge = edges[frame]
        inner = pose_of(edge.transform.translation, edge.transform.rotation)
        return pose(edge.header.frame_id) @ inner

    return {frame: pose(frame) for frame in edges}


def pose_of(p: Any, q: Any) -> Transform:
    return Transform((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def distance(a: Transform, b: Transform) -> float:
    """Return the largest difference between the numbers of two poses; q and -q are the same rotation."""
    apart = np.abs(np.subtract(a.position, b.position)).max()
    signs = (np.abs(np.add(a.rotation, s * np.array(b.rotation))).max() for s in (-1.0, 1.0))
    return max(apart, min(signs))
