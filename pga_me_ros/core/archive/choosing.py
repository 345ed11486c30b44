"""Choosing elites for a user: which one a request means, and what to say if there is none."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elite_table import EliteTable
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.errors import RequestError


class NotFoundError(RequestError):
    """The request is valid, but no elite meets it."""


class Judging(Enum):
    """By which fitness and descriptor elites are chosen."""

    BEST_KNOWN = "mean where known"
    """By the means of its re-evaluations where an elite has any, else by its single evaluation."""

    MEAN = "mean"
    """By the means of re-evaluations; elites without any are left out."""

    SINGLE = "single"
    """By the single evaluation that each was found with."""

    @classmethod
    def of(cls, *, by_mean: bool = False, single: bool = False) -> Judging:
        """Return what two switches ask for.

        Raises:
            RequestError: They contradict each other.
        """
        if by_mean and single:
            raise RequestError(
                "by_mean and single contradict each other; leave out what is not meant, or both: then the mean counts "
                "where there is one."
            )
        return cls.MEAN if by_mean else cls.SINGLE if single else cls.BEST_KNOWN


@dataclass(frozen=True)
class Demands:
    """What a user demands of an elite.

    Attributes:
        judging: By which fitness and descriptor it is chosen.
        min_fitness: Least fitness, inclusive.
        max_fall_share: Greatest share of its re-evaluations that ended in a fall, inclusive; infinite for any. An elite
            that was not re-evaluated is not known to meet one.

    Raises:
        RequestError: A limit is NaN, or the share is neither infinite nor from 0 to 1.
    """

    judging: Judging = Judging.BEST_KNOWN
    min_fitness: float = -math.inf
    max_fall_share: float = math.inf

    def __post_init__(self) -> None:
        """Check the limits."""
        if math.isnan(self.min_fitness):
            raise RequestError("min_fitness is NaN; give a number.")
        if not (0.0 <= self.max_fall_share <= 1.0 or self.max_fall_share == math.inf):
            raise RequestError(
                f"max_fall_share is {self.max_fall_share}; give a share from 0 to 1, for example 0.05."
            )

    @property
    def limits_falls(self) -> bool:
        """Whether there is a greatest share of falls."""
        return self.max_fall_share < math.inf

    @property
    def words(self) -> str:
        """The limits as they follow "No behavior", empty for none."""
        parts = []
        if self.min_fitness > -math.inf:
            parts.append(f"a fitness of {self.min_fitness:.1f} or more")
        if self.limits_falls:
            parts.append(f"falls in at most {_percent(self.max_fall_share)} of its evaluations")
        return f" with {' and '.join(parts)}" if parts else ""


@dataclass(frozen=True, eq=False)
class Choices:
    """The elites that a user may choose from.

    Attributes:
        archive: All elites.
        known: Their re-evaluations.
        descriptor_names: What each descriptor entry is, for messages.
        demands: What the user demands.
    """

    archive: Archive
    known: Statistics
    descriptor_names: Sequence[str]
    demands: Demands = field(default_factory=Demands)

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

    @cached_property
    def elites(self) -> EliteTable:
        """The elites with the fitness and the descriptors that they are judged by."""
        if self.demands.judging is Judging.SINGLE:
            return self.archive
        means = self.known.as_elites(self.archive)
        if self.demands.judging is Judging.MEAN:
            return means
        view = copy.copy(self.archive)
        view.fitness = np.where(means.filled, means.fitness, self.archive.fitness)
        view.descriptors = np.where(
            means.filled[:, None], means.descriptors, self.archive.descriptors
        )
        return view

    def by_mean(self, cell: int) -> bool:
        """Whether the elite of a cell is judged by the means of its re-evaluations."""
        return self.demands.judging is not Judging.SINGLE and bool(self.known.repeats[cell])

    def cells(self) -> Int64Array:
        """Return the cells whose elites meet the demands, ascending; at least one.

        Raises:
            NotFoundError: There are none.
        """
        cells = self.elites.filled_cells()
        if not len(cells):
            raise NotFoundError(
                "The repertoire is still empty; ask again after its first generation."
            )
        cells = cells[self.elites.fitness[cells] >= self.demands.min_fitness]
        if not len(cells):
            raise NotFoundError(
                f"No behavior has a fitness of {self.demands.min_fitness:.1f} or more; the best has "
                f"{self.elites.max_fitness:.1f}."
            )
        if not self.demands.limits_falls:
            return cells
        steady = cells[self.known.fall_share[cells] <= self.demands.max_fall_share]
        if not len(steady):
            raise NotFoundError(self._all_fall(cells))
        return steady

    def of_cell(self, cell: int) -> int:
        """Return the cell if its elite may be chosen.

        Raises:
            ArchiveError: There is no such cell.
            NotFoundError: The cell is empty, its elite was not re-evaluated though that is demanded, or it does not
                meet a limit.
        """
        if 0 <= cell < self.archive.cells and not self.elites.filled[cell]:
            if self.archive.filled[cell]:
                raise NotFoundError(f"The behavior of cell {cell} was not re-evaluated.")
            raise NotFoundError(
                f"Cell {cell} is empty; choose a filled one, or the nearest to a descriptor."
            )
        fitness, demands = self.elites.elite(cell).fitness, self.demands
        if fitness < demands.min_fitness:
            raise NotFoundError(
                f"The behavior of cell {cell} has fitness {fitness:.1f}, less than the {demands.min_fitness:.1f} that "
                "is required."
            )
        if demands.limits_falls and not self.known.fall_share[cell] <= demands.max_fall_share:
            raise NotFoundError(
                f"The behavior of cell {cell} {self._falls(cell)}; at most {_percent(demands.max_fall_share)} are "
                "allowed."
            )
        return cell

    def of_evaluation(self, evaluation: int) -> int:
        """Return the cell whose elite was found in an evaluation.

        Raises:
            NotFoundError: No elite was, or it does not meet a limit.
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
            NotFoundError: There is none that meets the demands.
        """
        cells = self.cells()
        return int(cells[self.elites.fitness[cells].argmax()])

    def fittest_first(self) -> Int64Array:
        """Return the cells whose elites meet the demands, the fittest first.

        Raises:
            NotFoundError: There is none.
        """
        cells = self.cells()
        return cells[np.argsort(-self.elites.fitness[cells], kind="stable")]

    def any(self, rng: np.random.Generator) -> int:
        """Return the cell of any elite that meets the demands.

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
            ArchiveError: The descriptor is not finite, or the distance is NaN.
            NotFoundError: There is none that is near and meets the demands; the message names the nearest.
        """
        wanted = np.asarray(descriptor, np.float64)
        if wanted.shape != (self.archive.dimensions,):
            raise RequestError(
                f"The descriptor has {wanted.size} entries; this repertoire's has {self.archive.dimensions}: "
                f"{', '.join(self.descriptor_names)}."
            )
        self.elites.nearest(wanted, count, max_distance)  # refuses what makes no sense
        try:
            fit = self.cells()
        except NotFoundError as reason:
            if not len(self.elites):
                raise
            nearest = self._nearest_in_words(wanted, self.elites.filled_cells())
            raise NotFoundError(f"{reason} {nearest}") from None
        view = copy.copy(self.elites)
        view.filled = np.zeros_like(view.filled)
        view.filled[fit] = True
        cells, distances = view.nearest(wanted, count, max_distance)
        if not len(cells):
            raise NotFoundError(
                f"No behavior{self.demands.words} lies within {max_distance:g} of {wanted.tolist()}. "
                f"{self._nearest_in_words(wanted, fit)}"
            )
        return cells, distances

    def _nearest_in_words(self, wanted: Float64Array, among: Int64Array) -> str:
        view = copy.copy(self.elites)
        view.filled = np.zeros_like(view.filled)
        view.filled[among] = True
        (cell,), (distance,) = view.nearest(wanted)
        numbers = ", ".join(f"{x:.3f}" for x in view.descriptors[cell])
        return (
            f"The nearest is that of cell {cell}, {distance:.3f} away: descriptor [{numbers}], fitness "
            f"{view.fitness[cell]:.1f}; it {self._falls(cell)}."
        )

    def _falls(self, cell: int) -> str:
        """Return how often an elite falls, as it follows its name."""
        repeats = int(self.known.repeats[cell])
        if not repeats:
            return "was not re-evaluated"
        return f"falls in {_percent(self.known.fall_share[cell])} of {repeats} re-evaluations"

    def _all_fall(self, cells: Int64Array) -> str:
        """Return that none of some elites is known to fall seldom enough."""
        demands = self.demands
        some = (
            f" with a fitness of {demands.min_fitness:.1f} or more"
            if demands.min_fitness > -math.inf
            else ""
        )
        text = f"No behavior{some} is known to fall in at most {_percent(demands.max_fall_share)} of its evaluations; "
        judged = cells[self.known.repeats[cells] > 0]
        if not len(judged):
            return f"{text}none was re-evaluated: do so with `ros2 run pga_me_ros reevaluate`."
        least = judged[self.known.fall_share[judged].argmin()]
        return f"{text}that of cell {least} {self._falls(int(least))}."


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
