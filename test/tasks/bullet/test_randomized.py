"""Domain randomization of the robots: each kind does what it says, and episodes stay repeatable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pybullet
import pytest

from pga_me_ros.tasks.bullet.randomized import PUSH_EVERY, PUSH_FOR
from pga_me_ros.tasks.bullet.world import FLOOR_FRICTION
from pga_me_ros.tasks.rollout import Episode, rollout

ALL = "mass 0.5 2, friction 0.2 2, torque 0.5 2, delay 0 3, noise 0 0.1, push 0 200"


@pytest.fixture
def make(made: Callable[..., Any]) -> Callable[..., Any]:
    """Make randomized tasks."""

    def new(randomization: str = "", name: str = "qd_hopper") -> Any:
        return made(name, randomization)

    return new


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def waving(task: Any) -> Callable[[Any], Any]:
    """Return a controller that moves all joints, and depends on what it sees."""

    def act(observation: Any) -> Any:
        n = task.spec.action_dim
        return np.tanh(observation[:n] + np.linspace(-0.5, 0.5, n)).astype(np.float32)

    return act


def episode(task: Any, seed: int) -> Episode:
    return rollout(task, waving(task), rng(seed), 120)


@pytest.mark.parametrize("name", ["qd_hopper", "qd_walker", "qd_half_cheetah", "qd_ant"])
def test_an_episode_depends_on_its_generator_alone(make: Callable[..., Any], name: str) -> None:
    task = make(ALL, name)
    first = episode(task, 1)
    for seed in (2, 3):
        episode(task, seed)
    assert episode(task, 1) == first
    assert episode(make(ALL, name), 1) == first
    assert episode(make("", name), 1) != first


def test_nothing_drawn_leaves_all_as_it_was(make: Callable[..., Any]) -> None:
    generator, other = rng(4), rng(4)
    task = make()
    task.reset(generator)
    other.uniform(-0.1, 0.1, task.spec.action_dim)
    assert generator.random() == other.random()


@pytest.mark.parametrize("kind", ["mass 1", "torque 1", "delay 0", "noise 0", "push 0"])
def test_a_factor_of_one_and_a_delay_of_none_change_nothing(
    make: Callable[..., Any], kind: str
) -> None:
    assert episode(make(kind), 5) == episode(make(), 5)


def dynamics(task: Any, link: int) -> Any:
    world = task._world
    return pybullet.getDynamicsInfo(world.robot, link, world.client)


def test_masses_and_inertias_are_those_of_the_model_times_a_factor(
    make: Callable[..., Any],
) -> None:
    plain, task = make(), make("mass 0.5 2")
    heavy = [k for k in range(plain._world.joint_count) if dynamics(plain, k)[0] > 0.0]
    factors = []
    for seed in (1, 2):
        task.reset(rng(seed))
        factors.append([dynamics(task, k)[0] / dynamics(plain, k)[0] for k in heavy])
        for link, factor in zip(heavy, factors[-1], strict=True):
            expected = np.array(dynamics(plain, link)[2]) * factor
            np.testing.assert_allclose(dynamics(task, link)[2], expected, rtol=1e-6)
    assert all(0.5 <= f <= 2.0 for fs in factors for f in fs)
    assert len({round(f, 6) for f in factors[0]}) == len(heavy), "links share a factor"
    assert factors[0] != factors[1]


def test_friction_is_that_of_the_floor_times_a_factor(make: Callable[..., Any]) -> None:
    task = make("friction 0.25")
    task.reset(rng(1))
    world = task._world
    assert pybullet.getDynamicsInfo(world.floor, -1, world.client)[1] == FLOOR_FRICTION * 0.25
    plain = make()._world
    assert pybullet.getDynamicsInfo(plain.floor, -1, plain.client)[1] == FLOOR_FRICTION


def test_weak_motors_do_less(make: Callable[..., Any]) -> None:
    speeds = []
    for kind in ("", "torque 0.5", "torque 0"):
        task = make(kind)
        task.reset(rng(1))
        task.step(np.ones(3, np.float32))
        speeds.append(abs(np.array(task.joint_states()[1])).sum())
    assert speeds[0] > speeds[1] > speeds[2]


def test_a_delayed_action_takes_effect_so_many_steps_later(make: Callable[..., Any]) -> None:
    plain, task = make(), make("delay 3")
    for each in (plain, task):
        each.reset(rng(1))
    actions = [np.full(3, a, np.float32) for a in (0.9, -0.5, 0.3, 0.7, -0.2)]
    idle = np.zeros(3, np.float32)
    expected = [plain.step(a) for a in [idle] * 3 + actions[:2]]
    for (observation, reward, fell), action in zip(expected, actions, strict=True):
        own = task.step(action)
        assert own[0].tobytes() == observation.tobytes()
        assert own[1:] == (reward, fell)


def test_noise_is_on_what_is_seen_and_on_nothing_else(make: Callable[..., Any]) -> None:
    plain, task = make(), make("noise 0.05")
    seen = []
    for each in (plain, task):
        each.reset(rng(1))
        seen.append([each.step(np.full(3, 0.1, np.float32)) for _ in range(60)])
    clean, noisy = (np.stack([o for o, _, _ in steps]) for steps in seen)
    assert [r for _, r, _ in seen[0]] == [r for _, r, _ in seen[1]]
    difference = noisy - clean
    contacts = len(task.robot.contact_links)
    assert not difference[:, -contacts:].any()
    inside = np.abs(clean[:, :-contacts]) < 4.5
    assert difference[:, :-contacts][inside].std() == pytest.approx(0.05, rel=0.15)
    assert np.abs(noisy).max() <= 5.0


def test_pushes_come_once_a_second_for_a_tenth_of_it(make: Callable[..., Any]) -> None:
    """In the cheetah's plane; it is pushed, or not, between two equal steps of a robot without motors."""
    plain, task = make("torque 0", "qd_half_cheetah"), make("torque 0, push 300", "qd_half_cheetah")
    pushed = []
    for each in (plain, task):
        each.reset(rng(6))
    speeds = [[], []]
    for step in range(2 * PUSH_EVERY):
        for which, each in enumerate((plain, task)):
            each.step(np.zeros(6, np.float32))
            speeds[which].append(each._torso()[2][0])
        if abs(speeds[1][-1] - speeds[0][-1]) > 1e-9:
            pushed.append(step)
    assert pushed, "nobody pushed"
    first = pushed[0]
    randomized = task._randomized
    assert first == randomized._phase
    gained = np.diff(np.array(speeds[1]) - np.array(speeds[0]), prepend=0.0)
    assert np.all(np.abs(gained[first : first + PUSH_FOR]) > 1e-3)
