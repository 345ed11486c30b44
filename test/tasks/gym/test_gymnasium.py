"""Tasks from Gymnasium: real environments with MuJoCo and classic control."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from pga_me_ros.errors import TaskError
from pga_me_ros.player.reader import reader_of
from pga_me_ros.tasks.check import check_task
from pga_me_ros.tasks.protocol import DivergedError, NonFiniteActionError
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import rollout

OWN = "swimming"
PENDULUM = f"gymnasium:Pendulum-v1?descriptor={OWN}:reach"


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def constant(action):
    return lambda _observation: np.asarray(action, np.float32)


@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("Walker2d-v5", (17, 6, 2)),
        ("HalfCheetah-v5", (17, 6, 2)),
        ("Ant-v5", (105, 8, 4)),
        ("Hopper-v5", (11, 3, 1)),
        ("Ant-v5?descriptor=final_position&include_cfrc_ext_in_observation=false", (27, 8, 2)),
    ],
)
def test_mujoco_robots_follow_the_protocol(name: str, sizes: tuple[int, ...]) -> None:
    task = load_task(f"gymnasium:{name}")
    spec = task.spec
    assert (spec.observation_dim, spec.action_dim, spec.descriptor_dim) == sizes
    assert not any(entry.startswith("observation_") for entry in spec.observation_names)
    assert spec.max_steps == 1000
    assert check_task(task) == []


def test_episode_equals_that_of_the_environment() -> None:
    actions = rng(5).uniform(-1, 1, (40, 6)).astype(np.float32)
    plays = iter(actions)
    task = load_task("gymnasium:HalfCheetah-v5")()
    episode = rollout(task, lambda _: next(plays), rng(3), 40)
    task.close()
    env = gymnasium.make("HalfCheetah-v5")
    states = [env.reset(seed=int(rng(3).integers(2**31)))[0]]
    rewards = []
    for action in actions:
        observation, reward, *_ = env.step(action)
        states.append(observation)
        rewards.append(reward)
    env.close()
    np.testing.assert_array_equal(episode.states, np.array(states, np.float32))
    np.testing.assert_array_equal(episode.rewards, np.array(rewards, np.float32))


def test_feet_descriptor_counts_the_contacts_that_mujoco_reports() -> None:
    task = load_task("gymnasium:Walker2d-v5")()
    task.reset(rng())
    data, model = task._env.unwrapped.data, task._env.unwrapped.model
    feet = [model.geom(name).id for name in ("foot_geom", "foot_left_geom")]
    touched = np.zeros(2)
    for t in range(1, 61):
        task.step(np.zeros(6, np.float32))
        pairs = [set(pair) for pair in data.contact.geom.tolist()]
        touched += [{model.geom("floor").id, foot} in pairs for foot in feet]
        np.testing.assert_allclose(task.descriptor(), touched / t)
    assert touched.min() > 0
    task.close()


def test_termination_is_a_fall_and_the_time_limit_is_not() -> None:
    hopper = load_task("gymnasium:Hopper-v5?max_steps=200")()
    fallen = rollout(hopper, constant([1.0, 1.0, 1.0]), rng())
    assert fallen.terminated
    assert fallen.length < 200
    hopper.close()
    cheetah = load_task("gymnasium:HalfCheetah-v5?max_steps=7")()
    whole = rollout(cheetah, constant(np.zeros(6)), rng())
    assert (whole.length, whole.terminated) == (7, False)
    cheetah.close()


def test_actions_cover_the_environments_range() -> None:
    task = load_task(f"gymnasium:Pendulum-v1?descriptor={OWN}:LastAction")()
    for action, torque in ((1.0, 2.0), (-1.0, -2.0), (0.5, 1.0), (3.0, 2.0)):
        task.reset(rng())
        task.step(np.array([action], np.float32))
        assert task.descriptor() == pytest.approx([torque])
    task.close()


def test_function_of_the_episode_is_a_descriptor() -> None:
    spec = load_task(PENDULUM).spec
    assert spec.descriptor_names == ("reach", "effort")
    assert (spec.descriptor_low, spec.descriptor_high) == ((-1.0, 0.0), (1.0, 2.0))
    assert check_task(load_task(PENDULUM)) == []


def test_bounds_and_sizes_in_the_name_count() -> None:
    spec = load_task(
        "gymnasium:Ant-v5?descriptor=final_position&low=-5,-6&high=7,8&max_steps=20&cells=100"
    ).spec
    assert (spec.descriptor_low, spec.descriptor_high) == ((-5.0, -6.0), (7.0, 8.0))
    assert (spec.max_steps, spec.archive_cells, spec.archive_bins) == (20, 100, (10, 10))


def test_non_finite_action_is_refused() -> None:
    task = load_task(PENDULUM)()
    with pytest.raises(NonFiniteActionError):
        task.step(np.array([np.nan], np.float32))
    task.close()
    task.close()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "names no environment"),
        ("Walkr2d-v5", "did you mean 'Walker2d-v5'"),
        ("CartPole-v1", "action space Discrete"),
        ("FrozenLake-v1", "observation space Discrete"),
        ("Pendulum-v1", "no feet are known"),
        ("Pendulum-v1?descriptor=final_position", "no robot that moves about"),
        ("Pendulum-v1?descriptor=fet", "did you mean 'feet'"),
        ("Pendulum-v1?descriptor=swimming:missing", "does not load"),
        ("Pendulum-v1?descriptor=swimming:without_bounds", "attributes 'low' and 'high'"),
        ("Ant-v5?low=-1,1,2", "3 lower"),
        ("Ant-v5?low=a", "numbers separated by commas"),
        ("Ant-v5?max_steps=0", "whole number from 1"),
        ("Ant-v5?max_steps=5&max_steps=6", "twice"),
        ("Ant-v5?max_steps", "option=value"),
        ("Ant-v5?no_such_argument=1", "no_such_argument"),
        ("Ant-v5?wrapper=swimming:Missing", "Missing"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(name: str, words: str) -> None:
    with pytest.raises(TaskError) as refused:
        load_task(f"gymnasium:{name}")
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_descriptor_of_the_wrong_length_is_named() -> None:
    task = load_task(f"gymnasium:Pendulum-v1?descriptor={OWN}:too_long")()
    task.reset(rng())
    with pytest.raises(TaskError, match=r"too_long.* expected 2 finite numbers"):
        task.descriptor()
    task.close()


def test_truncation_before_the_time_limit_is_named() -> None:
    task = load_task(f"{PENDULUM}&wrapper={OWN}:TruncatesEarly")()
    with pytest.raises(TaskError, match=r"after 3 steps.*max_steps=3"):
        rollout(task, constant([0.0]), rng())
    task.close()


def test_checker_finds_state_that_survives_a_reset() -> None:
    findings = check_task(load_task(f"{PENDULUM}&wrapper={OWN}:Remembers"))
    assert any("equal generators and actions gave different episodes" in f for f in findings)


def test_nan_of_an_environment_is_named() -> None:
    name = f"{PENDULUM}&wrapper={OWN}:GivesNan"
    assert any("NaN" in finding for finding in check_task(load_task(name)))
    task = load_task(name)()
    for controller in (constant([0.0]), lambda observation: np.tanh(observation[:1])):
        with pytest.raises(DivergedError, match=r"Pendulum.* left the finite numbers"):
            rollout(task, controller, rng())
    task.close()


def test_a_robot_outside_mujoco_cannot_be_shown() -> None:
    task = load_task(PENDULUM)()
    with pytest.raises(TaskError, match="cannot be shown: its environment is none of MuJoCo's"):
        reader_of(task)
    task.close()
