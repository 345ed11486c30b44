"""Readings become observations; those that are missing, old or not numbers are named."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry
from robot import SHIPPED, Sensors, controller_of
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray

from pga_me_ros.hardware.fields import FIELDS, TYPES, UnusableError
from pga_me_ros.hardware.mapping_file import read_mapping
from pga_me_ros.hardware.observer import PATIENCE, Observer, SensorError
from pga_me_ros.tasks.registry import make_task

HOPPER = read_mapping(SHIPPED / "qd_hopper.yaml")
CONTROLLER = controller_of("qd_hopper")
NAMES = list(CONTROLLER.observation_names)


@pytest.fixture(scope="module")
def readings() -> dict[str, Any]:
    """Return the messages of a hopper at its start."""
    task = make_task("qd_hopper")
    messages = Sensors(task).messages()
    task.close()
    return messages


@pytest.fixture
def observer(readings: dict[str, Any]) -> Observer:
    observer = Observer(HOPPER, CONTROLLER)
    for source, msg in readings.items():
        observer.take(source, msg, 1.0)
    return observer


def test_what_was_never_heard_is_missing(readings: dict[str, Any]) -> None:
    observer = Observer(HOPPER, CONTROLLER)
    for source, msg in readings.items():
        assert observer.missing(1.0, 9.0).endswith("was never heard")
        observer.take(source, msg, 1.0)
    assert observer.missing(1.0, 9.0) == ""


def test_what_is_old_is_missing(observer: Observer, readings: dict[str, Any]) -> None:
    assert observer.missing(1.5, 0.5) == ""
    for source in ("joints", "odometry", "contacts"):
        observer.take(source, readings[source], 2.0)
    assert observer.missing(2.0, 0.5) == "yaw on topic 'imu' is 1.00 s old"


def test_a_source_may_have_a_timeout_of_its_own(readings: dict[str, Any]) -> None:
    imu = dataclasses.replace(HOPPER.sources["imu"], timeout=0.01)
    sources = {**HOPPER.sources, "imu": imu}
    observer = Observer(dataclasses.replace(HOPPER, sources=sources), CONTROLLER)
    for source, msg in readings.items():
        observer.take(source, msg, 1.0)
    assert observer.missing(1.005, 0.5) == ""
    assert (observer.shortest_timeout(0.5), observer.shortest_timeout(0.001)) == (0.01, 0.001)
    assert observer.missing(1.02, 0.5) == "yaw on topic 'imu' is 0.02 s old"


def test_joints_may_be_divided_among_messages(readings: dict[str, Any]) -> None:
    observer = Observer(HOPPER, CONTROLLER)
    for source in ("odometry", "imu", "contacts"):
        observer.take(source, readings[source], 1.0)
    for joint in ("thigh_joint", "leg_joint", "foot_joint"):
        assert "'joint_states' was never heard" in observer.missing(1.0, 9.0)
        msg = JointState(name=["arm", joint], position=[7.0, 0.0], velocity=[7.0, 0.5])
        observer.take("joints", msg, 1.0)
    assert observer.missing(1.0, 9.0) == ""


def test_a_joint_that_never_comes_is_named() -> None:
    observer = Observer(HOPPER, CONTROLLER)
    names = ["thigh_joint", "leg_joint", "foot_jiont"]
    msg = JointState(name=names, position=[0.0] * 3, velocity=[0.0] * 3)
    for _ in range(PATIENCE - 1):
        observer.take("joints", msg, 1.0)
    words = (
        r"Topic 'joint_states' has no joint 'foot_joint' \(did you mean 'foot_jiont'\?\); it has "
        "thigh_joint, leg_joint, foot_jiont."
    )
    with pytest.raises(SensorError, match=words):
        observer.take("joints", msg, 1.0)


def test_a_joint_without_velocity_is_named() -> None:
    msg = JointState(name=["thigh_joint"], position=[0.0])
    with pytest.raises(
        SensorError, match="velocity of thigh_joint on topic 'joint_states' is miss"
    ):
        Observer(HOPPER, CONTROLLER).take("joints", msg, 1.0)


def test_an_array_that_is_too_short_is_named() -> None:
    with pytest.raises(
        SensorError, match="data 0 on topic 'contacts' is missing: the message has 0"
    ):
        Observer(HOPPER, CONTROLLER).take("contacts", Float64MultiArray(), 1.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_message_with_a_number_that_is_not_finite_is_not_used(
    observer: Observer, bad: float
) -> None:
    before = observer.observation()
    names = ["thigh_joint", "leg_joint", "foot_joint"]
    msg = JointState(name=names, position=[0.1, 0.1, bad], velocity=[0.0] * 3)
    with pytest.raises(
        UnusableError, match=f"position of foot_joint on topic 'joint_states' is {bad}"
    ):
        observer.take("joints", msg, 2.0)
    np.testing.assert_array_equal(observer.observation(), before)
    assert "1.00 s old" in observer.missing(2.0, 0.5)


def unknown(quantity: str) -> Imu:
    """Return a message of a sensor that does not measure a quantity, as sensor_msgs has it."""
    msg = Imu()
    getattr(msg, f"{quantity}_covariance")[0] = -1.0
    return msg


NO_ROTATION = Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)


@pytest.mark.parametrize(
    ("kind", "field", "msg", "words"),
    [
        ("sensor_msgs/Imu", "roll", unknown("orientation"), r"measures no orientation \(orient"),
        ("sensor_msgs/Imu", "angular_velocity.y", unknown("angular_velocity"), "no angular_vel"),
        ("sensor_msgs/Imu", "linear_acceleration.z", unknown("linear_acceleration"), "no linear"),
        ("sensor_msgs/Imu", "pitch", Imu(orientation=NO_ROTATION), "has length 0 instead of 1"),
        ("sensor_msgs/Imu", "yaw", Imu(orientation=Quaternion(w=0.45)), "has length 0.45 instead"),
    ],
)
def test_what_a_sensor_does_not_know_is_not_taken_for_zero(
    kind: str, field: str, msg: Any, words: str
) -> None:
    with pytest.raises(UnusableError, match=words):
        FIELDS[kind][field](msg)


def test_a_message_without_orientation_is_not_used(observer: Observer) -> None:
    msg = Odometry()
    msg.pose.pose.orientation = NO_ROTATION
    msg.twist.twist.linear.x = 2.0
    with pytest.raises(UnusableError, match="on topic 'odom' is not known, its orientation has"):
        observer.take("odometry", msg, 2.0)
    assert "on topic 'odom' is 1.00 s old" in observer.missing(2.0, 0.5)


def test_contacts_are_delayed_by_whole_control_periods(observer: Observer) -> None:
    seen = []
    for flag in (1.0, 0.0, 1.0, 1.0):
        observer.take("contacts", Float64MultiArray(data=[flag]), 1.0)
        seen.append(float(observer.observation()[NAMES.index("foot/contact")]))
    assert seen == [0.0, 1.0, 0.0, 1.0]


def test_entries_are_limited_as_in_the_task(observer: Observer) -> None:
    msg = JointState(name=["foot_joint"], position=[0.0], velocity=[1e6])
    observer.take("joints", msg, 1.0)
    assert observer.observation()[NAMES.index("foot_joint/velocity")] == 5.0


def test_scale_offset_and_function(tmp_path: Path) -> None:
    content = yaml.safe_load((SHIPPED / "qd_hopper.yaml").read_text())
    content["sources"] = {"foot": {"topic": "foot", "type": "std_msgs/Bool"}}
    content["sources"]["slope"] = {"topic": "slope", "type": "std_msgs/Float64"}
    content["observation"] = {name: {"constant": 0.25} for name in NAMES}
    content["observation"] |= {
        "foot/contact": {"source": "foot"},
        "torso/roll": {"source": "slope", "scale": 2.0, "offset": 1.0},
        "torso/pitch": {"source": "slope", "scale": -1.0, "function": "cos"},
    }
    file = tmp_path / "mapping.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    observer = Observer(read_mapping(file), CONTROLLER)
    observer.take("foot", Bool(data=True), 0.0)
    observer.take("slope", Float64(data=0.5), 0.0)
    seen = dict(zip(NAMES, observer.observation().tolist(), strict=True))
    assert (seen["foot/contact"], seen["torso/roll"], seen["torso/height"]) == (1.0, 2.0, 0.25)
    assert seen["torso/pitch"] == pytest.approx(math.cos(0.5))


def test_velocity_is_along_the_heading_not_along_a_pitched_torso() -> None:
    half = 0.5 * math.pi / 2
    msg = Odometry()  # turned left by a quarter, and moving forward in its own axes
    msg.pose.pose.orientation = Quaternion(z=math.sin(half), w=math.cos(half))
    msg.twist.twist.linear.x = 2.0
    read = FIELDS["nav_msgs/Odometry"]
    assert read["velocity.forward"](msg) == pytest.approx(2.0)
    assert read["yaw"](msg) == pytest.approx(math.pi / 2)
    msg.pose.pose.orientation = Quaternion(y=math.sin(-half), w=math.cos(half))  # nose up
    assert read["velocity.up"](msg) == pytest.approx(2.0)
    assert read["velocity.forward"](msg) == pytest.approx(0.0)


def test_every_field_of_every_type_can_be_read() -> None:
    samples = {"sensor_msgs/Imu": Imu(), "nav_msgs/Odometry": Odometry()}
    for kind, fields in FIELDS.items():
        for read in fields.values():
            assert math.isfinite(read(samples.get(kind, TYPES[kind]())))
