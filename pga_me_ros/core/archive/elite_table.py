"""The elites of an archive as a table: one row per cell, all fields sharing its index."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.elites import NO_PARENT, Elite
from pga_me_ros.core.operators import Operator
from pga_me_ros.errors import ArchiveError


class EliteTable:
    """Elites by cell, summaries of them, and ways to pick some.

    `parameters` takes memory only for cells that are filled.

    Args:
        cells: Number of cells.
        dimensions: Number d of descriptor dimensions.
        parameter_count: Number P of parameters of a controller.
        extent: (d,) range of each descriptor dimension, above 0. Distances are measured in shares of it.

    Raises:
        ArchiveError: A size is below 1, or memory cannot hold the table.
    """

    def __init__(
        self, cells: int, dimensions: int, parameter_count: int, extent: Float64Array
    ) -> None:
        """Make an empty table."""
        for name, size in (("cells", cells), ("parameter_count", parameter_count)):
            if size < 1:
                raise ArchiveError(f"{name} is {size}; expected at least 1.")
        self.extent = extent
        self.filled = np.zeros(cells, np.bool_)
        self.fitness = np.full(cells, np.nan)
        self.descriptors = np.full((cells, dimensions), np.nan)
        try:
            self.parameters = np.zeros((cells, parameter_count), np.float32)
        except (MemoryError, ValueError):  # ValueError: larger than the address space
            raise ArchiveError(
                f"An archive of {cells} cells with {parameter_count} parameters each takes "
                f"{4e-9 * cells * parameter_count:.0f} GB, which memory cannot hold; give controller_hidden or cells "
                "less."
            ) from None
        self.evaluations = np.full(cells, NO_PARENT, np.int64)
        self.generations = np.full(cells, -1, np.int64)
        self.operators = np.zeros(cells, np.int64)
        self.parents = np.full((cells, 2), NO_PARENT, np.int64)
        self.steps = np.zeros(cells, np.int64)
        self.terminated = np.zeros(cells, np.bool_)

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.filled)

    @property
    def dimensions(self) -> int:
        """Number d of descriptor dimensions."""
        return self.descriptors.shape[1]

    @property
    def parameter_count(self) -> int:
        """Number P of parameters of a controller."""
        return self.parameters.shape[1]

    def __len__(self) -> int:
        """Return the number of elites: the coverage (section 4.4)."""
        return int(np.count_nonzero(self.filled))

    @property
    def coverage(self) -> int:
        """Number of filled cells (section 4.4)."""
        return len(self)

    def qd_score(self, offset: float = 0.0) -> float:
        """Return the sum over elites of fitness - offset (section 4.4); exact, whatever the order.

        Args:
            offset: Lowest fitness of everything compared, so that more elites never score less.
        """
        return math.fsum(self.fitness[self.filled]) - offset * len(self)

    @property
    def max_fitness(self) -> float:
        """Fitness of the best elite, NaN for an empty archive."""
        return float(self.fitness[self.filled].max()) if len(self) else math.nan

    @property
    def min_fitness(self) -> float:
        """Fitness of the worst elite, NaN for an empty archive."""
        return float(self.fitness[self.filled].min()) if len(self) else math.nan

    @property
    def mean_fitness(self) -> float:
        """Mean fitness of the elites, NaN for an empty archive."""
        return self.qd_score() / len(self) if len(self) else math.nan

    def filled_cells(self) -> Int64Array:
        """Return the cells that hold an elite, ascending."""
        return np.flatnonzero(self.filled)

    def put(self, elite: Elite) -> None:
        """Make a solution the elite of its cell, whatever the cell held."""
        cell = elite.cell
        self.filled[cell] = True
        # Adding 0.0 turns -0.0 into 0.0; SQLite does not distinguish the two.
        self.fitness[cell] = elite.fitness + 0.0
        self.descriptors[cell] = elite.descriptor + 0.0
        self.parameters[cell] = elite.parameters
        self.evaluations[cell] = elite.evaluation
        self.generations[cell] = elite.generation
        self.operators[cell] = elite.operator
        self.parents[cell] = elite.parent1, elite.parent2
        self.steps[cell] = elite.steps
        self.terminated[cell] = elite.terminated

    def clear(self, cell: int) -> None:
        """Make a cell empty."""
        self.filled[cell] = self.terminated[cell] = False
        self.fitness[cell] = self.descriptors[cell] = np.nan
        self.parameters[cell] = self.operators[cell] = self.steps[cell] = 0
        self.evaluations[cell] = self.parents[cell] = NO_PARENT
        self.generations[cell] = -1

    def sample_parents(self, rng: np.random.Generator, n: int) -> Int64Array:
        """Draw cells uniformly over the filled ones, with replacement.

        The draw depends on which cells are filled, not on the order in which they were filled.

        Args:
            rng: Generator of the draw.
            n: Number of parents.

        Returns:
            (n,) int64 array of cells.

        Raises:
            ArchiveError: The archive is empty.
        """
        filled = self._filled_or_raise()
        return filled[rng.integers(len(filled), size=n)]

    def elite(self, cell: int) -> Elite:
        """Return the elite of a cell; its arrays are copies.

        Raises:
            ArchiveError: There is no such cell, or it is empty.
        """
        if not 0 <= cell < self.cells:
            raise ArchiveError(f"Cell {cell} does not exist; give one from 0 to {self.cells - 1}.")
        if not self.filled[cell]:
            raise ArchiveError(f"Cell {cell} is empty; ask for a filled one or for the nearest.")
        return Elite(
            cell=int(cell),
            fitness=float(self.fitness[cell]),
            descriptor=self.descriptors[cell].copy(),
            parameters=self.parameters[cell].copy(),
            evaluation=int(self.evaluations[cell]),
            generation=int(self.generations[cell]),
            operator=Operator(int(self.operators[cell])),
            parent1=int(self.parents[cell, 0]),
            parent2=int(self.parents[cell, 1]),
            steps=int(self.steps[cell]),
            terminated=bool(self.terminated[cell]),
        )

    def elites(self) -> Iterator[Elite]:
        """Yield all elites in the order of their cells."""
        return (self.elite(cell) for cell in self.filled_cells().tolist())

    def best(self) -> Elite:
        """Return the fittest elite; ties go to the lowest cell.

        Raises:
            ArchiveError: The archive is empty.
        """
        filled = self._filled_or_raise()
        return self.elite(int(filled[self.fitness[filled].argmax()]))

    def nearest(
        self, descriptor: ArrayLike, k: int = 1, max_distance: float = math.inf
    ) -> tuple[Int64Array, Float64Array]:
        """Return the elites whose descriptors are nearest to a given one.

        Distances are Euclidean, with each dimension in shares of its range: they do not depend on the descriptor's
        units, and from one corner of d dimensions to the opposite one it is sqrt(d).

        Args:
            descriptor: d numbers.
            k: Maximum number of elites.
            max_distance: Maximum distance, in shares of the range, inclusive.

        Returns:
            Cells, (m,) int64 with m <= k, and distances, (m,) float64; nearest first; ties go to
            the lower cell.

        Raises:
            ArchiveError: The descriptor has the wrong length, is not finite or immeasurably far away, k is below 1, or
                the distance is NaN.
        """
        if k < 1 or math.isnan(max_distance):
            raise ArchiveError(
                f"k={k}, max_distance={max_distance}: ask for at least one elite, and give a distance that is a number."
            )
        wanted = self.checked_descriptors(np.asarray(descriptor, np.float64)[None])[0]
        candidates = self.filled_cells()
        shares = (self.descriptors[candidates] - wanted) / self.extent
        with np.errstate(over="ignore"):
            distance = np.sqrt((shares**2).sum(axis=1))
        if not np.isfinite(distance).all():
            raise ArchiveError(
                f"The descriptor {wanted.tolist()} is too far away for a distance; give numbers like the elites'."
            )
        order = np.argsort(distance, kind="stable")
        order = order[distance[order] <= max_distance][:k]
        return candidates[order], distance[order]

    def checked_descriptors(self, descriptors: ArrayLike) -> Float64Array:
        """Return descriptors as a (n, d) float64 array without negative zeros.

        Raises:
            ArchiveError: The shape is wrong or a number is not finite.
        """
        values = np.asarray(descriptors, np.float64)
        if values.ndim != 2 or values.shape[1] != self.dimensions:
            raise ArchiveError(
                f"Descriptors have the shape {values.shape}; expected (n, {self.dimensions})."
            )
        if not np.isfinite(values).all():
            raise ArchiveError("Descriptors must be finite; NaN or infinity was among them.")
        # Adding 0.0 turns -0.0 into 0.0, so that equal descriptors have equal bits.
        return values + 0.0

    def _filled_or_raise(self) -> Int64Array:
        filled = self.filled_cells()
        if not len(filled):
            raise ArchiveError("The archive is empty; add solutions first.")
        return filled
