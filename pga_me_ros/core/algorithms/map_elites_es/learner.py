"""The step of MAP-Elites-ES (Colas et al. 2020) between two generations: from samples' results to the next center."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.algorithms.map_elites_es.archives import EsArchives, checked
from pga_me_ros.core.algorithms.map_elites_es.gradient import (
    Moments,
    adam_ascent,
    centered_ranks,
    gradient,
)
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import CENTER, GREEDY, Snapshot
from pga_me_ros.core.variation.mirrored_samples import directions, es_noise
from pga_me_ros.core.variation.random_controllers import random_controllers
from pga_me_ros.errors import PgaError
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


class EsLearner:
    """The state of the evolution strategy: center, Adam's moments, and archives.

    It climbs from a center for `es_steps` steps, each on the samples of one generation: up the fitness (exploit) or up
    the novelty of behaviors (explore). Then it switches between the two, restarts from an elite and resets Adam. The
    controller that a step reaches is evaluated once, in the first place of the next generation's batch, and offered to
    the archive; it is also the center of that generation's samples, unless the strategy restarts there.

    Args:
        spec: Task.
        settings: Settings of the run.

    Attributes:
        version: Steps taken since the start of the run.
        newest: Generation whose results it holds, -1 for none.
    """

    def __init__(self, spec: TaskSpec, settings: Settings) -> None:
        self._settings = settings
        self._shape = controller_shape(spec, settings)
        self._found = EsArchives(spec, settings, self._shape.parameter_count)
        self._center = random_controllers(settings, self._shape, 0, 0, 1)[0]
        self._reached = self._center
        self._moments = Moments.none(self._center.size)
        self._explore = False
        self._fitness = np.empty(0)
        self._behaviors = np.empty((0, spec.descriptor_dim))
        self.version = 0
        self.newest = -1

    def forget_experience(self) -> None:
        """Forget the newest generation's results."""
        self.newest = -1

    def add(self, generation: int, episodes: Iterable[Episode]) -> None:
        """Replace the previous generation's results.

        Args:
            generation: Number of the generation.
            episodes: All its episodes, in evaluation order; only fitness and descriptor are used.
        """
        episodes = list(episodes)
        self._fitness = np.array([e.fitness for e in episodes], np.float64)
        self._behaviors = np.stack([e.descriptor for e in episodes])
        self.newest = generation

    def start_greedy_at(self, parameters: Float32Array) -> None:
        """Refuse: the first center is the first controller of the run.

        Raises:
            PgaError: Always.
        """
        raise PgaError("map_elites_es starts at its first controller; remove greedy_init.")

    def train(self, rates: Settings, generation: int) -> Snapshot:
        """Take a step on the results of the previous generation.

        Args:
            rates: Settings with the rates in force; the strategy uses none of them.
            generation: Generation whose offspring it is for.

        Raises:
            PgaError: The results of the previous generation were not added.
            NetworkError: A parameter is not finite after the step.
        """
        if generation < 1 or self.newest != generation - 1:
            raise PgaError(
                f"The step for generation {generation} needs the results of the one before, but those of "
                f"{self.newest} are here; add them first."
            )
        self._found.add(self._reached, self._fitness[0], self._behaviors[0], generation - 1)
        self._reached, self._moments = self._step(generation - 1)
        self._shape.check(self._reached)
        if self._moments.steps < self._settings.es_steps:
            self._center = self._reached
        else:
            self._explore = not self._explore
            self._center = self._found.start(self._explore, generation)
            self._moments = Moments.none(self._center.size)
        self.version += 1
        return self._snapshot(generation)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the state by name, without the newest results."""
        return {
            "center": self._center,
            "reached": self._reached,
            "adam_mean": self._moments.mean,
            "adam_square": self._moments.square,
            "adam_steps": np.array([self._moments.steps], np.int64),
            "explore": np.array([self._explore], np.bool_),
            **self._found.state(),
        }

    def load_state(self, state: dict[str, NDArray[Any]], version: int) -> None:
        """Continue from a stored state, bit for bit.

        Args:
            state: What `state` returned.
            version: Steps taken by then.

        Raises:
            StorageError: Arrays are missing or do not fit the settings; nothing is changed then.
        """
        vectors = [
            checked(state, name, dtype, (self._center.size,)).copy()
            for name, dtype in (
                ("center", np.float32),
                ("reached", np.float32),
                ("adam_mean", np.float64),
                ("adam_square", np.float64),
            )
        ]
        steps = int(checked(state, "adam_steps", np.int64, (1,))[0])
        explore = bool(checked(state, "explore", np.bool_, (1,))[0])
        self._found.load_state(state)
        self._center, self._reached = vectors[:2]
        self._moments = Moments(vectors[2], vectors[3], steps)
        self._explore = explore
        self.version = version

    def _step(self, generation: int) -> tuple[Float32Array, Moments]:
        """Climb from the center on the samples of a generation."""
        s = self._settings
        achieved = self._fitness[1:]
        if self._explore:
            achieved = self._found.novelty(self._behaviors[1:])
        noise = directions(es_noise(s, generation), s.es_samples // 2, self._center.size)
        slope = gradient(centered_ranks(achieved), noise, self._center.size)
        slope -= s.es_l2 * self._center
        return adam_ascent(self._center, slope, self._moments, s.es_learning_rate)

    def _snapshot(self, generation: int) -> Snapshot:
        return Snapshot(
            generation=generation,
            version=self.version,
            networks={
                GREEDY: (self._shape, self._reached),
                CENTER: (self._shape, self._center),
            },
            states=np.empty((0, 0, 0, 0), np.float32),
            transitions=0,
            critic_loss=np.nan,
            mean_q=np.nan,
        )
