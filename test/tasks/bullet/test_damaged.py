"""Damage to the robots: each kind does what it says, episodes stay repeatable, and sound robots stay what they were."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pybullet
import pytest

from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.tasks.bullet.world import FLOOR_FRICTION
from pga_me_ros.tasks.rollout import Episode, rollout

DAMAGE = {
    "qd_hopper": "jam leg_joint -0.3, load 2, slope 4",
    "qd_walker": "gone thigh_left_joint, weak leg_joint 0.5, ice",
    "qd_half_cheetah": "free bshin, slippery ffoot, slope -4",
    "qd_ant": "gone ankle_1, jam hip_2 0.2, load 3, slippery left_back_foot",
}


@pytest.fixture
def make(made: Callable[..., Any]) -> Callable[..., Any]:
    """Make damaged tasks."""

    def new(damage: str = "", name: str = "qd_hopper", randomization: str = "") -> Any:
        return made(name, randomization, damage)

    return new


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def episode(task: Any, seed: int, steps: int = 120) -> Episode:
    """Run an episode in which all joints move, in a way that depends on what is seen."""
    n = task.spec.action_dim

    def act(observation: Any) -> Any:
        return np.tanh(observation[:n] + np.linspace(-0.5, 0.5, n)).astype(np.float32)

    return rollout(task, act, rng(seed), steps)


def dynamics(task: Any, link: int) -> Any:
    world = task._world
    return pybullet.getDynamicsInfo(world.robot, link, world.client)


def idle(task: Any, steps: int, action: float = 0.0) -> list[list[float]]:
    """Return the joints' positions after each of some steps of equal actions."""
    task.reset(rng(1))
    positions = []
    for _ in range(steps):
        task.step(np.full(task.spec.action_dim, action, np.float32))
        positions.append(task.joint_states()[0])
    return positions


@pytest.mark.parametrize("name", sorted(DAMAGE))
def test_an_episode_depends_on_its_generator_alone(make: Callable[..., Any], name: str) -> None:
    task = make(DAMAGE[name], name)
    first = episode(task, 1)
    for seed in (2, 3):
        episode(task, seed)
    assert episode(task, 1) == first
    assert episode(make(DAMAGE[name], name), 1) == first
    assert episode(make("", name), 1) != first


@pytest.mark.parametrize("damage", ["weak leg_joint 1", "load 0", "slope 0", "ice 1"])
def test_damage_of_no_size_changes_nothing(make: Callable[..., Any], damage: str) -> None:
    assert episode(make(damage), 5) == episode(make(), 5)


@pytest.mark.parametrize(("angle", "expected"), [("-0.4", -0.4), ("", 0.0)])
def test_a_jammed_joint_stays_where_it_is(
    make: Callable[..., Any], angle: str, expected: float
) -> None:
    task = make(f"jam leg_joint {angle}")
    stuck = np.array(idle(task, 40, action=1.0))[:, 1]
    np.testing.assert_allclose(stuck, expected, atol=0.01)
    assert task.reset(rng(1))[10] == pytest.approx(2 * (expected + 2.618) / 2.618 - 1, abs=0.01)


def test_a_jammed_joint_without_an_angle_stays_within_its_limits(
    make: Callable[..., Any],
) -> None:
    """An ant's ankle turns from 0.52 rad on; 0 is none of its angles."""
    task = make("jam ankle_1", "qd_ant")
    lower, upper = task._world.joint_limits[1]
    assert lower > 0.4
    np.testing.assert_allclose(np.array(idle(task, 40, 0.5))[:, 1], lower, atol=0.01)
    assert upper > lower


def test_weak_and_free_joints_turn_less_by_the_same_action(make: Callable[..., Any]) -> None:
    speeds = []
    for damage in ("", "weak thigh_joint 0.5", "free thigh_joint"):
        task = make(damage)
        task.reset(rng(1))
        task.step(np.array([-0.5, 0.0, 0.0], np.float32))
        speeds.append(abs(task.joint_states()[1][0]))
    assert speeds[0] > speeds[1] > speeds[2]


def test_a_missing_leg_weighs_and_touches_nothing_and_is_not_seen(
    make: Callable[..., Any],
) -> None:
    plain, task = make("", "qd_ant"), make("gone hip_1", "qd_ant")
    links = task._world.links
    mass = {each: [dynamics(each, k)[0] for k in links.values()] for each in (plain, task)}
    lighter = [
        name for name, a, b in zip(links, mass[plain], mass[task], strict=True) if b < 0.01 * a
    ]
    assert "front_left_foot" in lighter
    assert "front_right_foot" not in lighter
    feet = [0, 1, 2, 3]
    task.reset(rng(1))
    touched = np.zeros(4, bool)
    for _ in range(60):
        task.step(np.zeros(8, np.float32))
        touched |= np.array(task.contacts())[feet]
    assert not touched[0]
    assert touched[1:].any()
    shapes = [
        sum(len(link.shapes) for link in BodyReader(t.body).model.links) for t in (plain, task)
    ]
    assert shapes[1] < shapes[0]


def test_friction_of_foot_and_floor(make: Callable[..., Any]) -> None:
    plain, foot, floor = make(), make("slippery foot 0.25"), make("ice 0.5")
    link = plain._world.links["foot"]
    assert dynamics(foot, link)[1] == dynamics(plain, link)[1] * 0.25
    world = floor._world
    assert pybullet.getDynamicsInfo(world.floor, -1, world.client)[1] == FLOOR_FRICTION * 0.5


def test_randomized_friction_is_a_factor_of_that_of_the_ice(make: Callable[..., Any]) -> None:
    task = make("ice 0.5", randomization="friction 0.5")
    task.reset(rng(1))
    world = task._world
    assert pybullet.getDynamicsInfo(world.floor, -1, world.client)[1] == FLOOR_FRICTION * 0.25


def test_a_load_is_on_the_torso(make: Callable[..., Any]) -> None:
    plain, task = make(), make("load 2.5")
    torso = plain._world.torso
    assert dynamics(task, torso)[0] == pytest.approx(dynamics(plain, torso)[0] + 2.5)


def test_a_robot_slides_down_an_icy_slope(make: Callable[..., Any]) -> None:
    """The half-cheetah lies on its belly without motors; uphill is forward."""
    moved = []
    for damage in ("slope 10, ice 0", "slope -10, ice 0"):
        task = make(damage, "qd_half_cheetah")
        idle(task, 60)
        moved.append(task._torso()[0][0])
    assert moved[0] < -0.1
    assert moved[1] > 0.1
