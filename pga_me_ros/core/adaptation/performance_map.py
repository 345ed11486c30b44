"""What a repertoire promises: descriptor and fitness of each behavior, which adaptation starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.core.archive.choosing import Choices
from pga_me_ros.errors import RequestError


@dataclass(frozen=True, eq=False)
class PerformanceMap:
    """The behaviors that may be tried, one row each, by ascending cell.

    Attributes:
        cells: (n,) int64 cell of each, no two equal.
        evaluations: (n,) int64 evaluation that each was found with, which tells it from a later one of its cell.
        descriptors: (n, d) float64.
        fitness: (n,) float64 fitness that each promises: the mean of its re-evaluations where it has any.
        low: (d,) float64 least descriptor.
        high: (d,) float64 greatest descriptor.

    Raises:
        RequestError: There is no behavior, arrays do not fit each other, or a number is not finite.
    """

    cells: Int64Array
    evaluations: Int64Array
    descriptors: Float64Array
    fitness: Float64Array
    low: Float64Array
    high: Float64Array

    def __post_init__(self) -> None:
        """Check the arrays, and bring the rows into their order."""
        n = len(self.cells)
        if not n:
            raise RequestError(
                "The repertoire is empty: there is no behavior to try; grow it first."
            )
        d = len(self.low)
        shapes = [
            np.shape(a) for a in (self.evaluations, self.fitness, self.descriptors, self.high)
        ]
        if shapes != [(n,), (n,), (n, d), (d,)]:
            raise RequestError(
                f"The map's arrays have the shapes {shapes} for {n} cells; expected {[(n,), (n,), (n, d), (d,)]}."
            )
        numbers = (self.fitness, self.descriptors, self.low, self.high)
        if not all(np.isfinite(a).all() for a in numbers) or not (self.low < self.high).all():
            raise RequestError(
                "The map holds NaN, infinity or an empty range; expected finite numbers and low below high."
            )
        order = np.argsort(self.cells, kind="stable")
        for name in ("cells", "evaluations", "descriptors", "fitness"):
            object.__setattr__(self, name, np.array(getattr(self, name))[order])
        if (np.diff(self.cells) == 0).any():
            raise RequestError("The map has a cell twice; give each behavior once.")

    @classmethod
    def of(cls, choices: Choices) -> PerformanceMap:
        """Return the map of a stored run: ``PerformanceMap.of(run.choices())``.

        Args:
            choices: The elites to choose from; their demands limit which may be tried, and say what they promise.

        Raises:
            NotFoundError: None meets the demands.
        """
        cells, elites = choices.cells(), choices.elites
        return cls(
            cells,
            choices.archive.evaluations[cells],
            elites.descriptors[cells],
            elites.fitness[cells],
            np.asarray(choices.archive.low, np.float64),
            np.asarray(choices.archive.high, np.float64),
        )

    def only(self, rows: BoolArray) -> PerformanceMap:
        """Return the map of some of its behaviors.

        Args:
            rows: (n,) bool, True for each of them.

        Raises:
            RequestError: It is none.
        """
        columns = {
            name: getattr(self, name)[rows]
            for name in ("cells", "evaluations", "descriptors", "fitness")
        }
        return replace(self, **columns)

    @property
    def points(self) -> Float64Array:
        """(n, d) float64 descriptors in shares of their range."""
        return self.scaled(self.descriptors)

    def scaled(self, descriptors: Float64Array) -> Float64Array:
        """Return descriptors in shares of their range: (m, d) float64 as given."""
        return (descriptors - self.low) / (self.high - self.low)
