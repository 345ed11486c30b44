"""A simulated robot that makes trials, and what adaptation is compared with on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.adaptation.alternatives import hill_climb
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.rollout import Episode, rollout

Controller = Callable[[Float32Array], Float32Array]

POSES = 5
"""Initial poses that a robot begins its episodes in."""

FIRST_POSE = 10_000
"""Seed of the first of them, which no run evaluates with."""

CLIMB_TRIALS = 20
"""Trials of a hill climber."""


class Way(IntEnum):
    """How a gait is found; each draws the initial poses of its trials from a generator of its own."""

    CLIMB = 1
    ADAPT = 2
    RANDOM = 3

    def generator(self, repeat: int) -> np.random.Generator:
        """Return the generator of one of several repeats."""
        return np.random.default_rng([int(self), repeat])


@dataclass(frozen=True)
class Achieved:
    """What a controller achieves from all initial poses.

    Attributes:
        fitness: Mean fitness.
        falls: Number of episodes that ended in a fall, of `POSES`.
    """

    fitness: float
    falls: int


class Robot:
    """A robot in simulation, sound or damaged.

    Args:
        task: Its task; whoever made it closes it.
    """

    def __init__(self, task: Task) -> None:
        self._task = task

    def episode(self, controller: Controller, pose: int) -> Episode:
        """Run a controller from one of the initial poses, 0 to `POSES` - 1."""
        return rollout(self._task, controller, np.random.default_rng(FIRST_POSE + pose))

    def trial(self, controller: Controller, rng: np.random.Generator) -> Episode:
        """Run a controller from an initial pose that is drawn at random."""
        return self.episode(controller, int(rng.integers(POSES)))

    def average(self, controller: Controller) -> Achieved:
        """Run a controller from all initial poses."""
        return averaged([self.episode(controller, pose) for pose in range(POSES)])

    def climb(
        self, shape: MlpShape, parameters: Float32Array, rng: np.random.Generator
    ) -> MlpController:
        """Return the best controller that a hill climber finds in `CLIMB_TRIALS` trials.

        Args:
            shape: Layers of the controllers.
            parameters: (P,) float32 parameters that it begins with.
            rng: Source of its changes and of the initial poses.
        """

        def attempt(changed: Float32Array) -> float:
            return self.trial(MlpController(shape, changed), rng).fitness

        return MlpController(shape, hill_climb(parameters, CLIMB_TRIALS, attempt, rng))


def averaged(episodes: Sequence[Episode]) -> Achieved:
    """Return the mean of some episodes."""
    falls = sum(episode.terminated for episode in episodes)
    return Achieved(float(np.mean([episode.fitness for episode in episodes])), falls)
