"""One evaluation: a controller runs one episode of a task, and every transition is kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.protocol import DivergedError, NonFiniteActionError, Task
from pga_me_ros.tasks.spec import TaskSpec

LARGEST_REWARD = float(np.finfo(np.float32).max)
"""Largest absolute reward of a step: the replay buffer and the messages hold float32."""


@dataclass(frozen=True, eq=False)
class Episode:
    """What happened in one episode of T steps.

    Transition t is (states[t], actions[t], rewards[t], states[t + 1]). The arrays are copies, so callers may reuse
    theirs.

    Attributes:
        states: (T + 1, observation_dim) float32, the first from the reset.
        actions: (T, action_dim) float32, as the controller returned them.
        rewards: (T,) float32.
        fitness: Sum of the rewards in float64, in the order of the steps, before rounding them to
            float32.
        descriptor: (descriptor_dim,) float64.
        terminated: Whether the robot fell, even in the last allowed step; False if only the time
            limit ended it.
        intended: (descriptor_dim,) float64, the descriptor that its controller was meant to achieve; None where it was
            meant to achieve none in particular.
    """

    states: Float32Array
    actions: Float32Array
    rewards: Float32Array
    fitness: float
    descriptor: Float64Array
    terminated: bool
    intended: Float64Array | None = None

    def __post_init__(self) -> None:
        """Copy arrays that come from users' code, or that would keep a longer array in memory."""
        for name in ("states", "actions", "rewards"):
            object.__setattr__(self, name, np.array(getattr(self, name), np.float32))
        object.__setattr__(self, "descriptor", np.array(self.descriptor, np.float64))
        if self.intended is not None:
            object.__setattr__(self, "intended", np.array(self.intended, np.float64))

    def __eq__(self, other: object) -> bool:
        """Return whether two episodes are equal, bit for bit except for the sign of zeros."""
        if not isinstance(other, Episode):
            return NotImplemented
        return (self.fitness, self.terminated) == (other.fitness, other.terminated) and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("states", "actions", "rewards", "descriptor", "intended")
        )

    __hash__ = None  # type: ignore[assignment]

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

    If the simulation reaches NaN or infinity, the episode ends as a fall before that step. A reward
    beyond float32 counts as not finite.

    Args:
        task: The task; its earlier episodes do not matter.
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,)
            float32.
        rng: Source of the initial pose.
        max_steps: Time limit, steps; the task's by default.

    Raises:
        TaskError: `max_steps` is below 1, or the task returned an observation or a descriptor of the wrong shape or a
            descriptor that is not finite, or called sys.exit.
        NonFiniteActionError: The controller returned NaN or infinity. The task's next episode is
            not affected.
        DivergedError: The task returned NaN, infinity or a reward beyond float32 without ending
            the episode, or in its first step.
    """
    spec = task.spec
    limit = spec.max_steps if max_steps is None else max_steps
    if limit < 1:
        raise TaskError(f"an episode was given max_steps {limit}; expected at least 1")
    try:
        return _episode(task, controller, rng, limit)
    except SystemExit as error:
        raise TaskError(
            f"{spec.name} called sys.exit({error.code!r}) in an episode; raise an exception that says what is wrong"
        ) from error


def _episode(
    task: Task,
    controller: Callable[[Float32Array], Float32Array],
    rng: np.random.Generator,
    limit: int,
) -> Episode:
    spec = task.spec
    states = np.empty((limit + 1, spec.observation_dim), np.float32)
    actions = np.empty((limit, spec.action_dim), np.float32)
    rewards = np.empty(limit, np.float32)
    fitness = 0.0
    terminated = False
    observation = task.reset(rng)
    _put(states, 0, observation, spec)
    length = 0
    while length < limit and not terminated:
        action = actions[length] = controller(observation)
        try:
            observation, reward, terminated = task.step(action)
        except NonFiniteActionError:
            if not np.isfinite(states[length]).all():  # no fault of the controller
                raise _diverged(spec, length) from None
            raise
        _put(states, length + 1, observation, spec)
        if not abs(reward) <= LARGEST_REWARD:  # NaN fails every comparison
            if terminated:
                break
            raise DivergedError(
                f"{spec.name} left the finite numbers of float32: its reward in step {length + 1} is {reward}; a task "
                "must end the episode (terminated) in the step in which that happens"
            )
        if terminated and not np.isfinite(states[length + 1]).all():
            break
        rewards[length] = reward
        fitness += float(reward)
        length += 1
    states, actions, rewards = states[: length + 1], actions[:length], rewards[:length]
    if length == 0 or not np.isfinite(states).all():
        raise _diverged(spec, length)
    descriptor = _descriptor(task)
    return Episode(states, actions, rewards, fitness, descriptor, bool(terminated))


def _diverged(spec: TaskSpec, length: int) -> DivergedError:
    """Return the error for a task that returned NaN or infinity and went on, after so many steps."""
    return DivergedError(
        f"{spec.name} left the finite numbers within {length + 1} steps; a task must end the "
        "episode (terminated) in the step in which that happens, and not begin with it"
    )


def _put(states: Float32Array, step: int, observation: Float32Array, spec: TaskSpec) -> None:
    """Copy an observation into its row; without the check, NumPy would broadcast a single number."""
    if np.shape(observation) != states.shape[1:]:
        raise TaskError(
            f"{spec.name} gave an observation of shape {np.shape(observation)} in step {step}; "
            f"expected ({spec.observation_dim},)"
        )
    states[step] = observation


def _descriptor(task: Task) -> Float64Array:
    """Return the descriptor of the episode, checked.

    Raises:
        TaskError: Its shape is wrong or a number in it is not finite.
    """
    spec = task.spec
    descriptor = np.array(task.descriptor(), np.float64)
    if descriptor.shape != (spec.descriptor_dim,) or not np.isfinite(descriptor).all():
        raise TaskError(
            f"{spec.name} gave the descriptor {descriptor.tolist()}; expected {spec.descriptor_dim} finite numbers "
            f"({', '.join(spec.descriptor_names)})"
        )
    return descriptor
