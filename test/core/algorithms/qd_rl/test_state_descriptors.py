"""State descriptors of episodes compared with contacts counted during the episode."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from lane_task import Lane, SteeredLane

from pga_me_ros.core.algorithms.qd_rl.state_descriptors import state_descriptors
from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import rollout


def draws(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize(
    "name", ["qd_walker", "qd_half_cheetah", "qd_ant", "qd_hopper", SteeredLane.spec.name]
)
def test_each_row_is_the_descriptor_of_the_episode_so_far(name):
    task = SteeredLane() if name == SteeredLane.spec.name else load_task(name)()
    rng, so_far = draws(1), []

    def controller(_):
        so_far.append(task.descriptor())
        # Half the strength keeps robots on their feet for longer, so that there is more to add up.
        return rng.uniform(-0.5, 0.5, task.spec.action_dim).astype(np.float32)

    try:
        episode = rollout(task, controller, draws(0), 70)
    finally:
        task.close()
    expected = [*so_far[1:], episode.descriptor]
    got = state_descriptors(task.spec, episode)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, expected, atol=1e-6)


@pytest.mark.parametrize("steps", [1, 2])
def test_the_shortest_episodes_have_them_too(steps):
    task = load_task("qd_hopper")()
    episode = rollout(task, lambda _: np.zeros(3, np.float32), draws(0), steps)
    got = state_descriptors(task.spec, episode)
    assert got.shape == (steps, 1)
    np.testing.assert_allclose(got[-1], episode.descriptor)


def test_they_are_in_shares_of_the_descriptors_range():
    task = SteeredLane()
    episode = rollout(task, lambda _: np.ones(2, np.float32), draws(0))
    wide = dataclasses.replace(task.spec, descriptor_low=(-1.0,))
    np.testing.assert_allclose(
        state_descriptors(wide, episode), (state_descriptors(task.spec, episode) + 1) / 2
    )


def test_the_error_for_a_task_without_them_says_what_to_add():
    with pytest.raises(TaskError, match="step_descriptor_names"):
        state_descriptors(Lane.spec, rollout(Lane(), lambda _: np.zeros(2, np.float32), draws(0)))
