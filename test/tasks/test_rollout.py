"""Rollouts of a task that can be computed by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from broken_tasks import (
    Diverges,
    HugeReward,
    HugeRewardAtTheEnd,
    LateHugeReward,
    LateNan,
    NanDescriptor,
    Point,
    SameArrays,
    ShortObservation,
    StepExits,
)

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.protocol import DivergedError, NonFiniteActionError
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import Episode, rollout


def push(_: np.ndarray) -> np.ndarray:
    return np.array([0.5], np.float32)


def run(task: object = None, controller: object = push, steps: int | None = None) -> Episode:
    return rollout(task or Point(), controller, np.random.default_rng(1), steps)  # type: ignore[arg-type]


def test_transitions_match_the_steps_in_order() -> None:
    task = Point()
    state = task.reset(np.random.default_rng(1))
    states, rewards = [state], []
    for _ in range(5):
        state, reward, _ = task.step(push(state))
        states.append(state)
        rewards.append(reward)
    episode = run(steps=5)
    assert np.array_equal(episode.states, states)
    assert np.array_equal(episode.rewards, np.array(rewards, np.float32))
    assert episode.fitness == sum(rewards)


def test_shapes_and_dtypes() -> None:
    episode = run(steps=5)
    assert episode.states.shape == (6, 2)
    assert episode.actions.shape == (5, 1)
    assert episode.rewards.shape == (5,)
    assert episode.descriptor.shape == (1,)
    dtypes = [getattr(episode, name).dtype for name in ("states", "actions", "rewards")]
    assert dtypes == [np.float32] * 3
    assert episode.length == 5


def test_actions_are_those_of_the_controller_for_each_state() -> None:
    def lean(observation: np.ndarray) -> np.ndarray:
        return np.tanh(10 * observation[:1])

    episode = run(controller=lean, steps=20)
    wanted = [lean(state) for state in episode.states[:-1]]
    assert np.array_equal(episode.actions, wanted)


def test_fall_ends_the_episode_and_is_terminal() -> None:
    episode = run(controller=lambda _: np.ones(1, np.float32))
    assert episode.terminated
    assert abs(episode.states[-1, 0]) > 2 >= np.abs(episode.states[:-1, 0]).max()


def test_time_limit_ends_the_episode_and_is_not_terminal() -> None:
    episode = run(controller=lambda _: np.zeros(1, np.float32))
    assert (episode.length, episode.terminated) == (50, False)


def test_short_episode_does_not_keep_the_memory_of_a_long_one() -> None:
    episode = run(controller=lambda _: np.ones(1, np.float32))
    assert episode.states.base is None
    assert episode.states.nbytes == (episode.length + 1) * 8


def test_divergence_ends_the_episode_before_the_step_that_diverged() -> None:
    episode = run(Diverges())
    assert (episode.length, episode.terminated) == (9, True)
    assert np.isfinite(episode.states).all()


@pytest.mark.parametrize("steps", [None, 20])
def test_a_task_may_return_the_same_arrays_every_time(steps: int | None) -> None:
    same, plain = SameArrays(), Point()
    for force in (0.9, 0.1, -0.9):
        action = np.array([force], np.float32)
        kept = [run(task, lambda _, a=action: a, steps) for task in (same, plain)]
        if force == 0.9:
            first = kept
    for one, other in (first, kept):
        for name in ("states", "actions", "rewards", "descriptor"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert first[0].descriptor != kept[0].descriptor


def test_an_episode_has_its_own_arrays() -> None:
    given = {name: np.ones((2, 2), np.float32) for name in ("states", "actions", "rewards")}
    given["descriptor"] = np.ones(2)
    episode = Episode(**given, fitness=1.0, terminated=False)
    for array in given.values():
        array[:] = 7.0
    assert all((getattr(episode, name) == 1.0).all() for name in given)


@pytest.mark.parametrize("task", [HugeReward, LateHugeReward])
def test_reward_beyond_float32_is_refused_with_its_value(task: type[Point]) -> None:
    with pytest.raises(DivergedError, match=r"float32: its reward in step (1|20) is 1e\+39;"):
        run(task())


def test_reward_beyond_float32_that_ends_the_episode_is_a_divergence() -> None:
    episode = run(HugeRewardAtTheEnd())
    assert (episode.length, episode.terminated) == (9, True)
    assert np.isfinite(episode.rewards).all()


def test_largest_float32_reward_is_kept() -> None:
    largest = float(np.finfo(np.float32).max)

    class Largest(Point):
        def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool]:
            observation, _, fell = super().step(action)
            return observation, -largest, fell

    assert (run(Largest(), steps=3).rewards == np.float32(-largest)).all()


def test_descriptor_that_is_not_finite_is_reported_with_its_value() -> None:
    with pytest.raises(TaskError, match=r"gave the descriptor \[nan\]; expected 1 finite numbers"):
        run(NanDescriptor())


def test_observation_of_the_wrong_shape_is_reported() -> None:
    with pytest.raises(TaskError, match=r"observation of shape \(1,\) in step 5; expected \(2,\)"):
        run(ShortObservation())


def test_task_that_exits_in_a_step_is_reported() -> None:
    with pytest.raises(TaskError, match=r"called sys.exit\(0\)"):
        run(StepExits())


def test_divergence_that_the_task_does_not_report_is_refused() -> None:
    with pytest.raises(DivergedError, match="must end the episode"):
        run(LateNan())


def test_non_finite_controller_is_refused() -> None:
    with pytest.raises(NonFiniteActionError):
        run(load_task("qd_hopper")(), lambda _: np.full(3, np.nan, np.float32))


def test_max_steps_below_one_is_refused() -> None:
    with pytest.raises(TaskError, match="at least 1"):
        run(steps=0)


def test_action_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(TaskError, match="2 entries; expected 3"):
        load_task("qd_hopper")().step(np.zeros(2, np.float32))


def test_episode_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        run(steps=1).fitness = 1.0  # type: ignore[misc]
