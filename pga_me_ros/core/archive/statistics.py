"""What elites did on average when they were re-evaluated: mean, spread and falls, per cell."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elite_table import EliteTable


@dataclass(frozen=True)
class Statistics:
    """Mean and spread of the re-evaluations of each cell's elite.

    Attributes:
        repeats: (cells,) int64 re-evaluations of the elite, 0 for none.
        mean_fitness: (cells,) float64, NaN where there is none.
        fitness_spread: (cells,) float64 sample standard deviation, NaN for fewer than two.
        mean_descriptor: (cells, d) float64, NaN where there is none.
        descriptor_spread: (cells, d) float64 sample standard deviation, NaN for fewer than two.
        fall_share: (cells,) float64 share of the re-evaluations that ended in a fall, NaN where there is none.
    """

    repeats: Int64Array
    mean_fitness: Float64Array
    fitness_spread: Float64Array
    mean_descriptor: Float64Array
    descriptor_spread: Float64Array
    fall_share: Float64Array

    @classmethod
    def none(cls, cells: int, dimensions: int) -> Statistics:
        """Return the statistics of elites that were not re-evaluated.

        Args:
            cells: Number of cells.
            dimensions: Number d of descriptor dimensions.
        """
        return cls(
            np.zeros(cells, np.int64),
            np.full(cells, np.nan),
            np.full(cells, np.nan),
            np.full((cells, dimensions), np.nan),
            np.full((cells, dimensions), np.nan),
            np.full(cells, np.nan),
        )

    def known(self, archive: EliteTable) -> Int64Array:
        """Return the filled cells whose elites were re-evaluated, ascending."""
        return np.flatnonzero(archive.filled & (self.repeats > 0))

    def as_elites(self, archive: Archive) -> EliteTable:
        """Return elites as their means tell them; those that were not re-evaluated are left out.

        Args:
            archive: The archive that the statistics are of.

        Returns:
            A view with fitness and descriptors replaced by means, for choosing cells. An elite's mean descriptor may
            lie in another cell than its own.
        """
        view = copy.copy(archive)
        view.filled = archive.filled & (self.repeats > 0)
        view.fitness = self.mean_fitness
        view.descriptors = self.mean_descriptor
        return view
