"""What is damaged, as text: read, or refused with what was wrong."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import pytest

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.damage import KINDS, DamageError, Fault, read_damage
from pga_me_ros.tasks.registry import damage_option, make_task
from pga_me_ros.tasks.spec import TaskSpec


def test_faults_come_in_the_order_of_the_text_with_their_defaults() -> None:
    assert read_damage("ice, jam  knee -0.5,weak hip 0.25, slippery foot, slope -3") == (
        Fault("ice", "", 0.1),
        Fault("jam", "knee", -0.5, given=True),
        Fault("weak", "hip", 0.25, given=True),
        Fault("slippery", "foot", 0.0),
        Fault("slope", "", -3.0, given=True),
    )


@pytest.mark.parametrize("text", ["", "   "])
def test_nothing_is_nothing(text: str) -> None:
    assert read_damage(text) == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("jamm knee", r"'jamm knee' \(did you mean 'jam'\?\); give KIND PART VALUE"),
        ("broken knee", "KIND is one of jam, weak, free, gone, slippery, load, slope, ice"),
        ("ice,", "has ''; give KIND PART VALUE"),
        ("jam", "'jam' without a joint; say which: jam NAME"),
        ("slippery", "'slippery' without a link"),
        ("jam knee bent", "'jam knee bent'; expected a number from"),
        ("jam knee nan", "'jam knee nan'; expected a number from"),
        ("jam knee 0.1 0.2", "expected 'jam JOINT VALUE'"),
        ("free knee 0.1", "expected 'free JOINT': the joint turns freely"),
        ("weak knee 1.5", "'weak knee 1.5'; expected a number from 0 to 1"),
        ("load", "'load' without a number; the torso carries this mass, kg"),
        ("load -1", "'load -1'; expected a number from 0 to 1000"),
        ("slope 90", "'slope 90'; expected a number from -60 to 60"),
        ("ice 0.1 0.2", "expected 'ice VALUE'"),
        ("ice, ice 0.2", "'ice' twice; give it once"),
        ("jam knee, jam knee 0.1", "'jam knee' twice; give it once"),
        ("jam knee, weak knee", "'jam' and 'weak' of knee; give one of them"),
    ],
)
def test_what_makes_no_sense_is_refused(text: str, words: str) -> None:
    with pytest.raises(DamageError, match=words):
        read_damage(text)
    assert issubclass(DamageError, TaskError)


@pytest.mark.parametrize(
    ("name", "damage", "words"),
    [
        ("qd_hopper", "jam foot_joints", r"'foot_joints', which qd_hopper has not \(did you mean"),
        ("qd_hopper", "gone hip_1", "its joints are thigh_joint, leg_joint, foot_joint"),
        ("qd_walker", "slippery front_left_foot", "its links are foot, foot_left"),
        ("gymnasium:Hopper-v5", "ice", "cannot be damaged: its class takes no argument `damage`"),
        ("gymnasium:Hopper-v5", "iced", "did you mean 'ice'"),
    ],
)
def test_damage_of_another_robot_is_refused_without_a_simulator(
    name: str, damage: str, words: str
) -> None:
    with pytest.raises(DamageError, match=words):
        damage_option(name, damage)


def test_a_joint_jams_only_where_it_turns() -> None:
    with pytest.raises(DamageError, match=r"at 1 rad, but on qd_hopper it turns from -2\.618 to"):
        make_task("qd_hopper", damage="jam leg_joint 1")


class Plain:
    """A task without the argument."""

    spec: ClassVar[Any] = TaskSpec(
        "t", ("o",), ("",), ("a",), ("",), (-1.0,), (1.0,), ("d",), (0.0,), (1.0,), 1, 1.0, 1, (1,)
    )


class Able(Plain):
    """A task with it, whose robot's parts are its own matter."""

    def __init__(self, *, damage: str = "") -> None:
        self.damage = damage


def test_a_task_of_ones_own_gets_the_text_if_it_takes_it() -> None:
    able = make_task(f"{__name__}:Able", damage="jam anything 0.3")
    assert isinstance(able, Able)
    assert able.damage == "jam anything 0.3"
    with pytest.raises(DamageError, match="takes no argument `damage`"):
        make_task(f"{__name__}:Plain", damage="ice")
    assert isinstance(make_task(f"{__name__}:Plain", damage=" "), Plain)


def test_every_kind_says_what_it_is_and_has_a_default_within_its_limits() -> None:
    for kind in KINDS.values():
        assert kind.meaning
        assert kind.default is None or kind.low <= kind.default <= kind.high
    assert KINDS["jam"].high == math.pi
