"""Episodes with an observer, which does not affect them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.player.model import RobotModel, RobotState
from pga_me_ros.player.reader import Reader, reader_of
from pga_me_ros.tasks.body import AnyBody
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.rollout import Episode, rollout

Look = Callable[[int, Reader], None]


def watched_rollout(
    task: Task,
    controller: Callable[[Float32Array], Float32Array],
    rng: np.random.Generator,
    look: Look,
) -> Episode:
    """Run one episode as `rollout` does, and call an observer before the first and after each step.

    Args:
        task: The task; it must have a `body`.
        controller: As in `rollout`.
        rng: Source of the initial pose.
        look: Called with the number of steps done and the reader of the robot. An exception ends the episode.

    Raises:
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    reader = reader_of(task)
    steps = 0

    def act(observation: Float32Array) -> Float32Array:
        nonlocal reader, steps
        if steps == 0:  # the reset may have opened another world
            reader = reader_of(task)
        look(steps, reader)
        steps += 1
        return controller(observation)

    episode = rollout(task, act, rng)
    look(steps, reader)
    return episode


@dataclass(frozen=True)
class Recording:
    """A recorded episode, for drawing.

    Attributes:
        model: The robot.
        states: Its recorded states.
        steps: Number of steps before each state.
        episode: The episode.
        body: The robot in its simulation.
    """

    model: RobotModel
    states: tuple[RobotState, ...]
    steps: tuple[int, ...]
    episode: Episode
    body: AnyBody


def record(
    task: Task,
    controller: Callable[[Float32Array], Float32Array],
    rng: np.random.Generator,
    every: int = 1,
) -> Recording:
    """Run one episode and keep the states of the robot.

    Args:
        task: As in `watched_rollout`.
        controller: As in `watched_rollout`.
        rng: As in `watched_rollout`.
        every: Steps between two states.

    Raises:
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    states: list[RobotState] = []
    steps: list[int] = []
    readers: list[Reader] = []

    def look(step: int, reader: Reader) -> None:
        if step % every == 0:
            states.append(reader.state())
            steps.append(step)
            readers[:] = [reader]

    episode = watched_rollout(task, controller, rng, look)
    read = readers[0]
    return Recording(read.model, tuple(states), tuple(steps), episode, read.body)
