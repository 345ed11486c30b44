"""What an archive takes in and gives out: evaluated solutions and the elites among them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pga_me_ros.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from pga_me_ros.core.operators import Operator
from pga_me_ros.errors import ArchiveError

NO_PARENT = -1
"""Evaluation id that stands for no parent."""


class Status(IntEnum):
    """The outcome for a solution that was offered to the archive."""

    REJECTED = 0
    NEW = 1
    IMPROVED = 2


@dataclass(frozen=True)
class Elite:
    """The fittest solution found for one cell.

    Attributes:
        cell: Index of its cell.
        fitness: Sum of rewards of its one evaluation.
        descriptor: (d,) float64 achieved descriptor.
        parameters: (P,) float32 parameters of its controller.
        evaluation: Id of the evaluation, counted from 0 over the run.
        generation: Generation that evaluated it.
        operator: Operator that made it.
        parent1: Evaluation id of the parent, `NO_PARENT` for none.
        parent2: Evaluation id of the second parent, `NO_PARENT` for none.
        steps: Steps of its episode.
        terminated: Whether the episode ended by falling rather than by the time limit.
    """

    cell: int
    fitness: float
    descriptor: Float64Array
    parameters: Float32Array
    evaluation: int
    generation: int
    operator: Operator
    parent1: int
    parent2: int
    steps: int
    terminated: bool

    def to_bytes(self) -> bytes:
        """Return all of it as bytes, the same for the same elite on every machine (little endian).

        Raises:
            struct.error: A number does not fit its field.
        """
        head = struct.pack(
            "<qdqqqqqq?",
            self.cell,
            self.fitness,
            self.evaluation,
            self.generation,
            self.operator,
            self.parent1,
            self.parent2,
            self.steps,
            self.terminated,
        )
        descriptor = np.asarray(self.descriptor, "<f8").tobytes()
        return head + descriptor + np.asarray(self.parameters, "<f4").tobytes()


@dataclass(frozen=True)
class Solutions:
    """A batch of n evaluated solutions, in evaluation order.

    Attributes:
        fitness: (n,) float64.
        descriptors: (n, d) float64.
        parameters: (n, P) float32.
        evaluations: (n,) int64 evaluation ids.
        generations: (n,) int64.
        operators: (n,) int64 values of `Operator`.
        parents: (n, 2) int64 evaluation ids, `NO_PARENT` for none.
        steps: (n,) int64 steps per episode.
        terminated: (n,) bool, whether the episode ended by falling.
    """

    fitness: Float64Array
    descriptors: Float64Array
    parameters: Float32Array
    evaluations: Int64Array
    generations: Int64Array
    operators: Int64Array
    parents: Int64Array
    steps: Int64Array
    terminated: BoolArray

    @classmethod
    def of(
        cls,
        *,
        fitness: ArrayLike,
        descriptors: ArrayLike,
        parameters: ArrayLike,
        evaluations: Sequence[int] | range | Int64Array,
        generation: int = 0,
        operators: Sequence[Operator] | Int64Array | None = None,
        parents: ArrayLike | None = None,
        steps: ArrayLike | None = None,
        terminated: ArrayLike | None = None,
    ) -> Solutions:
        """Make a batch from anything array-like; by default, solutions are random ones without parents.

        Args:
            fitness: n numbers.
            descriptors: (n, d) numbers.
            parameters: (n, P) numbers.
            evaluations: n evaluation ids.
            generation: Generation that evaluated all of them.
            operators: n operators.
            parents: (n, 2) evaluation ids.
            steps: n episode lengths.
            terminated: n flags.

        Raises:
            ArchiveError: Shapes do not fit together.
        """
        count = len(evaluations)
        batch = cls(
            fitness=np.asarray(fitness, np.float64),
            descriptors=np.asarray(descriptors, np.float64),
            parameters=np.asarray(parameters, np.float32),
            evaluations=np.asarray(evaluations, np.int64),
            generations=np.full(count, generation, np.int64),
            operators=_column(operators, Operator.RANDOM, (count,), np.int64),
            parents=_column(parents, NO_PARENT, (count, 2), np.int64),
            steps=_column(steps, 0, (count,), np.int64),
            terminated=_column(terminated, False, (count,), np.bool_),
        )
        batch.check_shapes()
        return batch

    def __len__(self) -> int:
        """Return the number of solutions."""
        return len(self.evaluations)

    def elite(self, i: int, cell: int) -> Elite:
        """Return the i-th solution as the elite of a cell; its parameters are a view."""
        return Elite(
            cell=cell,
            fitness=float(self.fitness[i]),
            descriptor=self.descriptors[i],
            parameters=self.parameters[i],
            evaluation=int(self.evaluations[i]),
            generation=int(self.generations[i]),
            operator=Operator(int(self.operators[i])),
            parent1=int(self.parents[i, 0]),
            parent2=int(self.parents[i, 1]),
            steps=int(self.steps[i]),
            terminated=bool(self.terminated[i]),
        )

    def check_shapes(self) -> None:
        """Check that all arrays describe the same n solutions.

        Raises:
            ArchiveError: An array has another shape.
        """
        count = len(self.evaluations)
        tails = {"descriptors": None, "parameters": None, "parents": 2}
        for name, value in vars(self).items():
            width = tails.get(name, 0)
            ndim = 1 if width == 0 else 2
            if value.ndim != ndim or len(value) != count or (width and value.shape[1] != width):
                wanted = {0: f"({count},)", None: f"({count}, any)"}.get(width, f"({count}, 2)")
                raise ArchiveError(
                    f"{name} has the shape {value.shape}; {count} evaluations need {wanted}."
                )


def _column(values: ArrayLike | None, default: int, shape: tuple[int, ...], dtype: type) -> NDArray:
    return np.full(shape, default, dtype) if values is None else np.asarray(values, dtype)
