"""One evaluation: a controller runs one episode of a task, and every transition is kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pga_me_ros.core.errors import TaskError
from pga_me_ros.tasks.protocol import DivergedError, Float32Array, Float64Array, Task


@dataclass(frozen=True)
class Episode:
    """What happened in one episode of T steps.

    Transition t is (states[t], actions[t], rewards[t], states[t + 1]).

    Attributes:
        states: (T + 1, observation_dim) float32, the first from the reset.
        actions: (T, action_dim) float32, as the controller gave them.
        rewards: (T,) float32.
        fitness: Sum of the rewards in float64 in the order of the steps, before they were rounded
            to float32.
        descriptor: (descriptor_dim,) float64.
        terminated: Whether the robot fell, be it in the last allowed step; False when only the time
            limit ended it.
    """

    states: Float32Array
    actions: Float32Array
    rewards: Float32Array
    fitness: float
    descriptor: Float64Array
    terminated: bool

    @property
    def length(self) -> int:
        """Number of steps T."""
        return len(self.rewards)


def rollout(
    task: Task,
    controller: Callable[[Float32Array], Float32Array],
    rng: np.random.Generator,
    max_steps: int | None = None,
) -> Episode:
    """Run one episode.

    A simulation that leaves the finite numbers ends the episode as a fall before the step in which
    it did so.

    Args:
        task: The task; its earlier episodes do not matter.
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,)
            float32.
        rng: Source of the initial pose.
        max_steps: Time limit, steps; the task's by default.

    Raises:
        TaskError: `max_steps` is below 1.
        NonFiniteActionError: The controller gave NaN or infinity. The task's next episode is not
            affected.
        DivergedError: The task gave NaN or infinity without ending the episode, or in its first
            step.
    """
    spec = task.spec
    limit = spec.max_steps if max_steps is None else max_steps
    if limit < 1:
        raise TaskError(f"an episode was given max_steps {limit}; expected at least 1")
    states = np.empty((limit + 1, spec.observation_dim), np.float32)
    actions = np.empty((limit, spec.action_dim), np.float32)
    rewards = np.empty(limit, np.float32)
    fitness = 0.0
    terminated = False
    observation = states[0] = task.reset(rng)
    length = 0
    while length < limit and not terminated:
        action = actions[length] = controller(observation)
        observation, reward, terminated = task.step(action)
        if terminated and not (math.isfinite(reward) and np.isfinite(observation).all()):
            break
        rewards[length] = reward
        fitness += reward
        length += 1
        states[length] = observation
    states, actions, rewards = states[: length + 1], actions[:length], rewards[:length]
    if length == 0 or not (math.isfinite(fitness) and np.isfinite(states).all()):
        raise DivergedError(
            f"{spec.name} left the finite numbers within {length + 1} steps; a task must end the "
            "episode (terminated) in the step in which that happens, and not begin with it"
        )
    if length < limit:
        # Short episodes must not hold the memory of a thousand steps in a replay buffer.
        states, actions, rewards = states.copy(), actions.copy(), rewards.copy()
    return Episode(states, actions, rewards, fitness, task.descriptor(), terminated)
