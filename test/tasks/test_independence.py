"""An episode depends only on its generator and actions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pytest

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.tasks.bullet.locomotion import QDWalker
from pga_me_ros.tasks.protocol import NonFiniteActionError
from pga_me_ros.tasks.registry import BUILT_IN, load_task
from pga_me_ros.tasks.rollout import Episode, rollout

DATA = Path(__file__).parent / "data"


@pytest.fixture(params=list(BUILT_IN))
def task(request: pytest.FixtureRequest) -> Iterator[Any]:
    task = load_task(request.param)()
    yield task
    task.close()


def episode(task: Any, seed: int, steps: int = 60) -> Episode:
    rng = np.random.default_rng(1000 + seed)
    dimension = task.spec.action_dim

    def controller(_: np.ndarray) -> np.ndarray:
        return rng.uniform(-1, 1, dimension).astype(np.float32)

    return rollout(task, controller, np.random.default_rng(seed), steps)


def assert_same(one: Episode, other: Episode) -> None:
    assert one.states.tobytes() == other.states.tobytes()
    assert one.rewards.tobytes() == other.rewards.tobytes()
    assert one.descriptor.tobytes() == other.descriptor.tobytes()
    assert (one.fitness, one.terminated) == (other.fitness, other.terminated)


def test_first_episode_equals_the_one_after_ten_others(task: Any) -> None:
    first = episode(task, 1)
    for seed in range(2, 12):
        episode(task, seed, 30)
    assert_same(first, episode(task, 1))


def test_fresh_world_equals_a_used_one(task: Any) -> None:
    for seed in range(2, 5):
        episode(task, seed, 30)
    fresh = type(task)()
    try:
        assert_same(episode(fresh, 1), episode(task, 1))
    finally:
        fresh.close()


def test_steps_after_a_fall_have_no_effect_on_the_next_episode(task: Any) -> None:
    first = episode(task, 1)
    task.reset(np.random.default_rng(9))
    for _ in range(200):
        task.step(np.ones(task.spec.action_dim, np.float32))
    assert_same(first, episode(task, 1))


def test_interleaved_worlds_do_not_interact(task: Any) -> None:
    alone = episode(task, 1)
    other = type(task)()
    try:
        action = np.full(task.spec.action_dim, 0.5, np.float32)
        other.reset(np.random.default_rng(3))

        def controller(_: np.ndarray) -> np.ndarray:
            other.step(action)
            return rng.uniform(-1, 1, task.spec.action_dim).astype(np.float32)

        rng = np.random.default_rng(1001)
        assert_same(alone, rollout(task, controller, np.random.default_rng(1), 60))
    finally:
        other.close()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_non_finite_action_is_refused_before_it_acts(task: Any, bad: float) -> None:
    first = episode(task, 1)
    task.reset(np.random.default_rng(2))
    action = np.zeros(task.spec.action_dim, np.float32)
    action[-1] = bad
    with pytest.raises(NonFiniteActionError, match="controller's parameters"):
        task.step(action)
    assert_same(first, episode(task, 1))


def test_world_that_diverged_is_rebuilt(task: Any) -> None:
    first = episode(task, 1)
    task.reset(np.random.default_rng(2))
    world = task._world
    pybullet.setJointMotorControl2(
        world.robot,
        world.joints[0],
        pybullet.TORQUE_CONTROL,
        force=float("nan"),
        physicsClientId=world.client,
    )
    terminated = False
    for _ in range(5):
        terminated = terminated or task.step(np.zeros(task.spec.action_dim, np.float32))[2]
    assert terminated
    assert_same(first, episode(task, 1))


def test_contacts_of_the_last_episode_do_not_act_in_the_next():
    with np.load(DATA / "walker_leftover_contacts.npz") as stored:
        shape = MlpShape(tuple(stored["sizes"].tolist()))
        first, second = (MlpController(shape, stored[name]) for name in ("first", "second"))
    used, fresh = QDWalker(), QDWalker()
    rollout(used, first, evaluation_rng(0, 19))  # falls with a foot where the next episode puts one
    episodes = [rollout(task, second, evaluation_rng(0, 23)) for task in (used, fresh)]
    used.close()
    fresh.close()
    assert episodes[0].states.tobytes() == episodes[1].states.tobytes()
