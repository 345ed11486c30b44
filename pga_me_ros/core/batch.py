"""One generation: its controllers, their origin, and finally their results."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array, Int64Array
from pga_me_ros.core.archive.elites import NO_PARENT, Solutions
from pga_me_ros.tasks.rollout import Episode


class Outcome(Protocol):
    """The result of an evaluation."""

    @property
    def fitness(self) -> float:
        """Sum of rewards."""

    @property
    def descriptor(self) -> Float64Array:
        """(d,) achieved descriptor."""

    @property
    def length(self) -> int:
        """Steps of the episode."""

    @property
    def terminated(self) -> bool:
        """Whether the episode ended by falling rather than by the time limit."""


@dataclass(frozen=True)
class Batch:
    """Controllers of one generation.

    Attributes:
        generation: Number of the generation, from 0.
        evaluations: Ids of their evaluations.
        operators: (b,) int64 values of `Operator`.
        parents: (b, 2) int64 evaluation ids of the parents, `NO_PARENT` for none.
        parameters: (b, P) float32.
        intended: (b, d) float64 descriptors that they are meant to achieve, NaN where there is none.
    """

    generation: int
    evaluations: range
    operators: Int64Array
    parents: Int64Array
    parameters: Float32Array
    intended: Float64Array

    @classmethod
    def empty(
        cls, generation: int, evaluations: range, parameter_count: int, descriptor_dim: int
    ) -> Batch:
        """Return a batch that is still to be filled in, in place."""
        b = len(evaluations)
        return cls(
            generation,
            evaluations,
            np.zeros(b, np.int64),
            np.full((b, 2), NO_PARENT, np.int64),
            np.empty((b, parameter_count), np.float32),
            np.full((b, descriptor_dim), np.nan),
        )

    def with_aims(self, episodes: Sequence[Episode]) -> list[Episode]:
        """Return the batch's episodes, in order, with the descriptor that each was meant to achieve."""
        return [
            episode if np.isnan(aim).any() else dataclasses.replace(episode, intended=aim)
            for episode, aim in zip(episodes, self.intended, strict=True)
        ]

    def solutions(self, outcomes: Sequence[Outcome]) -> Solutions:
        """Return the batch as solutions for the archive.

        Args:
            outcomes: Results of its evaluations, in order.

        Raises:
            ArchiveError: The number of outcomes, or the size of a descriptor, does not fit.
        """
        return Solutions.of(
            fitness=[o.fitness for o in outcomes],
            descriptors=[o.descriptor for o in outcomes],
            parameters=self.parameters,
            evaluations=self.evaluations,
            generation=self.generation,
            operators=self.operators,
            parents=self.parents,
            steps=[o.length for o in outcomes],
            terminated=[o.terminated for o in outcomes],
        )
