"""Mapping files: every mistake in them is named in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from robot import SHIPPED, controller_of

from pga_me_ros.errors import SettingsError
from pga_me_ros.hardware.mapping import RobotMapping
from pga_me_ros.hardware.mapping_file import read_mapping

HOPPER = SHIPPED / "qd_hopper.yaml"
POSITION = {"action": "thigh_joint/torque", "low": -1.0, "high": 3.0, "rate": 4.0}


def changed(folder: Path, **values: Any) -> RobotMapping:
    """Read the hopper's mapping with some keys replaced, written `section__name__key`; None leaves the key out."""
    content = yaml.safe_load(HOPPER.read_text())
    for path, value in values.items():
        *sections, last = path.split("__")
        place = content
        for section in sections:
            place = place[section.replace("_at_", "/")]
        if value is None:
            del place[last.replace("_at_", "/")]
        else:
            place[last.replace("_at_", "/")] = value
    file = folder / "mapping.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    return read_mapping(file)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"task": None}, "it lacks task."),
        ({"taks": "x"}, "it has an unknown key 'taks' (did you mean 'task'?); expected task, "),
        ({"sources": {}}, "sources is {}; expected at least one name"),
        (
            {"sources__imu__type": "Imu"},
            "sources imu: type is 'Imu'; expected sensor_msgs/JointState or sens",
        ),
        ({"sources__imu__timeout": 0}, "sources imu: timeout is 0; give a number above 0."),
        ({"sources__imu__reliable": 1}, "sources imu: reliable is 1; give true or false."),
        (
            {"sources__gps": {"topic": "gps", "type": "sensor_msgs/Imu"}},
            "sources has 'gps', which no",
        ),
        (
            {"observation__torso_at_roll": 3},
            "observation torso/roll is 3; expected the keys source,",
        ),
        ({"observation__torso_at_roll__source": "imv"}, "source is 'imv' (did you mean 'imu'?)"),
        ({"observation__torso_at_roll__field": "rol"}, "field is 'rol' (did you mean 'roll'?)"),
        ({"observation__torso_at_roll__field": None}, "observation torso/roll: field is None"),
        ({"observation__torso_at_roll__joint": "x"}, "a field of sensor_msgs/Imu takes no joint."),
        (
            {"observation__foot_joint_at_velocity__joint": None},
            "sensor_msgs/JointState needs joint.",
        ),
        ({"observation__foot_at_contact__index": None}, "std_msgs/Float64MultiArray needs index."),
        (
            {"observation__foot_at_contact__index": -1},
            "index is -1; give a whole number from 0 on.",
        ),
        ({"observation__foot_at_contact__delay": 0.5}, "delay is 0.5; give a whole number"),
        ({"observation__torso_at_roll__scale": "x"}, "scale is 'x'; give a finite number."),
        ({"observation__torso_at_roll__offset": float("nan")}, "offset is nan; give a finite"),
        (
            {"observation__torso_at_roll__function": "tan"},
            "function is 'tan'; expected sin or cos.",
        ),
        (
            {"observation__foot_joint_at_position__low": 9.0},
            "low is 9 and high is 0.785398; give lo",
        ),
        ({"commands__kind": "torque"}, "commands: kind is 'torque'; expected effort or position."),
        (
            {"commands__joints__foot_joint__limit": 0.0},
            "foot_joint: limit is 0; give a number above",
        ),
        (
            {"commands__joints__foot_joint__limit": -5},
            "foot_joint: limit is -5; give a number above",
        ),
        (
            {"commands__joints__foot_joint__rate": 0},
            "foot_joint: rate is 0; give a number above 0.",
        ),
        ({"commands__joints__foot_joint__scale": True}, "scale is True; give a finite number."),
        (
            {"commands__joints__foot_joint__low": 1},
            "has an unknown key 'low'; expected action, scale",
        ),
    ],
)
def test_a_mistake_in_the_file(tmp_path: Path, values: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError) as error:
        changed(tmp_path, **values)
    assert words in str(error.value)
    assert str(error.value).startswith(f"Mapping '{tmp_path}/mapping.yaml': ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"observation__foot_at_contact": None, "observation__torso_at_roll": None,
             "sources__contacts": None},
            "observation lacks torso/roll, foot/contact; the controller needs all.",
        ),
        (
            {"observation__torso_at_rol": {"constant": 0}},
            "observation has 'torso/rol' (did you mean 'torso/roll'?), but the controller's entries",
        ),
        ({"commands__joints__foot_joint": None}, "commands lacks foot_joint/torque; the controller"),
        (
            {"commands__joints__foot_joint__action": "toe/torque"},
            "commands has 'toe/torque' (did you mean 'thigh_joint/torque'?), but the controller's act",
        ),
        (
            {"commands__joints__toe": {"action": "foot_joint/torque", "scale": 1, "limit": 1, "rate": 1}},
            "commands uses foot_joint/torque for two joints; give each its own.",
        ),
        (
            {"observation__leg_joint_at_position__low": None,
             "observation__leg_joint_at_position__high": None},
            "leg_joint/position is in the unit '-1 lower limit, +1 upper limit'; give low and high, "
            "-2.61799 and 0.",
        ),
        (
            {"observation__leg_joint_at_position__low": -2.0},
            "leg_joint/position has the limits -2 and 0, but the behavior was grown with -2.61799",
        ),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_controller(
    tmp_path: Path, values: dict[str, Any], words: str
) -> None:
    mapping = changed(tmp_path, **values)
    with pytest.raises(SettingsError) as error:
        mapping.require_fits(controller_of("qd_hopper"))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_the_documented_mapping_is_one(tmp_path: Path) -> None:
    page = (SHIPPED.parents[1] / "docs" / "hardware.md").read_text()
    (tmp_path / "page.yaml").write_text(page.partition("```yaml\n")[2].partition("```")[0])
    mapping = read_mapping(tmp_path / "page.yaml")
    with pytest.raises(
        SettingsError, match="observation lacks leg_joint/position, leg_joint/veloci"
    ):
        mapping.require_fits(controller_of("qd_hopper"))


def test_the_mapping_of_another_robot() -> None:
    words = (
        "is for task 'qd_hopper', but the behavior is one of 'qd_walker'; give the mapping of that"
    )
    with pytest.raises(SettingsError, match=words):
        read_mapping(HOPPER).require_fits(controller_of("qd_walker"))


def test_limits_are_needed_also_where_the_repertoire_does_not_tell_them(tmp_path: Path) -> None:
    older = controller_of("qd_hopper", joint_names=[], joint_low=[], joint_high=[])
    read_mapping(HOPPER).require_fits(older)
    keys = ("observation__leg_joint_at_position__low", "observation__leg_joint_at_position__high")
    with pytest.raises(SettingsError, match="give low and high"):
        changed(tmp_path, **dict.fromkeys(keys)).require_fits(older)


def test_no_file_and_a_file_that_is_not_yaml(tmp_path: Path) -> None:
    with pytest.raises(
        SettingsError, match=r"There is no mapping '.*qd_hoper.yaml' \(did you mean"
    ):
        read_mapping(HOPPER.with_name("qd_hoper.yaml"))
    (tmp_path / "twice.yaml").write_text("task: a\ntask: b\n")
    with pytest.raises(SettingsError, match="at line 2, column 1: 'task' is given twice"):
        read_mapping(tmp_path / "twice.yaml")


def test_positions_need_measured_ones(tmp_path: Path) -> None:
    joints = {"thigh_joint": POSITION}
    mapping = changed(tmp_path, commands__kind="position", commands__joints=joints)
    assert mapping.positions
    (joint,) = mapping.joints
    assert (joint.scale, joint.offset, joint.low, joint.high) == (2.0, 1.0, -1.0, 3.0)
    keys = [
        f"{joint}_joint_at_{what}"
        for joint in ("thigh", "leg", "foot")
        for what in ("position", "velocity")
    ]
    constants = {f"observation__{key}": {"constant": 0.0} for key in keys}
    with pytest.raises(SettingsError, match=r"start from the measured positions; give one source"):
        changed(
            tmp_path, **constants, sources__joints=None, commands__kind="position",
            commands__joints=joints,
        )  # fmt: skip
