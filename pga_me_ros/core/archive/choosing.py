"""Choosing elites for a user: which one a request means, and what to say if there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.elite_table import EliteTable
from pga_me_ros.errors import RequestError


class NotFoundError(RequestError):
    """The request is valid, but no elite meets it."""


@dataclass(frozen=True, eq=False)
class Choices:
    """The elites that a user may choose from.

    Attributes:
        archive: All elites.
        elites: What they are judged by: the archive itself, or their means over re-evaluations
            (`Statistics.as_elites`).
        descriptor_names: What each descriptor entry is, for messages.
        min_fitness: Minimum fitness, inclusive.
    """

    archive: EliteTable
    elites: EliteTable
    descriptor_names: Sequence[str]
    min_fitness: float = -math.inf

    def __post_init__(self) -> None:
        """Check that there are elites to judge.

        Raises:
            NotFoundError: The elites are judged by their means, but none was re-evaluated.
        """
        if len(self.archive) and not len(self.elites):
            raise NotFoundError(
                "No behavior of this repertoire was re-evaluated; do so with `ros2 run pga_me_ros reevaluate`, or "
                "choose without by_mean."
            )

    def cells(self) -> Int64Array:
        """Return the cells whose elites are fit enough, ascending; at least one.

        Raises:
            NotFoundError: There are none.
        """
        cells = self.elites.filled_cells()
        if not len(cells):
            raise NotFoundError(
                "The repertoire is still empty; ask again after its first generation."
            )
        cells = cells[self.elites.fitness[cells] >= self.min_fitness]
        if not len(cells):
            raise NotFoundError(
                f"No behavior has a fitness of {self.min_fitness:.1f} or more; the best has "
                f"{self.elites.max_fitness:.1f}."
            )
        return cells

    def of_cell(self, cell: int) -> int:
        """Return the cell if its elite may be chosen.

        Raises:
            ArchiveError: There is no such cell.
            NotFoundError: The cell is empty, its elite was not re-evaluated, or it is not fit enough.
        """
        if 0 <= cell < self.archive.cells and not self.elites.filled[cell]:
            if self.archive.filled[cell]:
                raise NotFoundError(f"The behavior of cell {cell} was not re-evaluated.")
            raise NotFoundError(
                f"Cell {cell} is empty; choose a filled one, or the nearest to a descriptor."
            )
        fitness = self.elites.elite(cell).fitness
        if fitness < self.min_fitness:
            raise NotFoundError(
                f"The behavior of cell {cell} has fitness {fitness:.1f}, less than the {self.min_fitness:.1f} that is "
                "required."
            )
        return cell

    def of_evaluation(self, evaluation: int) -> int:
        """Return the cell whose elite was found in an evaluation.

        Raises:
            NotFoundError: No elite was found in it, or it is not fit enough.
        """
        found = np.flatnonzero(self.archive.filled & (self.archive.evaluations == evaluation))
        if not len(found):
            raise NotFoundError(
                f"The controller of evaluation {evaluation} is no elite, so it was not kept; `export --to csv` lists "
                "those that are."
            )
        return self.of_cell(int(found[0]))

    def fittest(self) -> int:
        """Return the cell of the fittest elite; ties go to the lowest cell.

        Raises:
            NotFoundError: No elite is fit enough.
        """
        cells = self.cells()
        return int(cells[self.elites.fitness[cells].argmax()])

    def any(self, rng: np.random.Generator) -> int:
        """Return the cell of a random elite that is fit enough.

        Raises:
            NotFoundError: No elite is fit enough.
        """
        return int(rng.choice(self.cells()))

    def nearest(
        self, descriptor: Sequence[float], count: int = 1, max_distance: float = math.inf
    ) -> tuple[Int64Array, Float64Array]:
        """Return the elites nearest to a descriptor.

        Args:
            descriptor: d numbers.
            count: Maximum number of elites.
            max_distance: Maximum Euclidean distance, inclusive.

        Returns:
            Cells, (m,) int64 with 1 <= m <= count, and distances, (m,) float64; nearest first.

        Raises:
            RequestError: The descriptor has the wrong length.
            ArchiveError: The descriptor is not finite, or a limit is NaN.
            NotFoundError: No elite is near and fit enough.
        """
        wanted = np.asarray(descriptor, np.float64)
        if wanted.shape != (self.archive.dimensions,):
            raise RequestError(
                f"The descriptor has {wanted.size} entries; this repertoire's has {self.archive.dimensions}: "
                f"{', '.join(self.descriptor_names)}."
            )
        cells, distances = self.elites.nearest(wanted, count, max_distance, self.min_fitness)
        if not len(cells):
            self.cells()
            limit = (
                f" with a fitness of {self.min_fitness:.1f} or more."
                if self.min_fitness > -math.inf
                else "."
            )
            raise NotFoundError(
                f"No behavior lies within {max_distance:g} of {wanted.tolist()}{limit}"
            )
        return cells, distances
