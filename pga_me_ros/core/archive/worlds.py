"""Worlds that a robot may be in, as it was simulated in them: each tells what every behavior achieves there.

As in Kaushik, Desreumaux & Mouret, *Adaptive Prior Selection for Repertoire-based Online Adaptation in Robotics*
(Frontiers in Robotics and AI 2020, arXiv 1907.07029), several maps are priors, and trials tell which of them fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.errors import RequestError


@dataclass(frozen=True, eq=False)
class Worlds:
    """What behaviors achieve in some worlds. `StoredRun.worlds` has those of a run.

    Attributes:
        evaluations: (m,) int64 evaluation that each behavior was found with, ascending, no two equal.
        fitness: (k, m) float64 fitness of each in each of the k worlds.

    Raises:
        RequestError: Arrays do not fit each other, or a number is not finite.
    """

    evaluations: Int64Array
    fitness: Float64Array

    def __post_init__(self) -> None:
        """Check the arrays."""
        m = len(self.evaluations)
        if self.fitness.ndim != 2 or self.fitness.shape[1] != m:
            raise RequestError(
                f"The worlds' fitness has the shape {self.fitness.shape} for {m} behaviors; expected (worlds, {m})."
            )
        if not np.isfinite(self.fitness).all() or (np.diff(self.evaluations) <= 0).any():
            raise RequestError(
                "The worlds hold a fitness that is not finite, or behaviors out of order; expected finite numbers, "
                "and each behavior once."
            )

    def known(self, evaluations: Int64Array) -> BoolArray:
        """Return which behaviors were evaluated there: (n,) bool for (n,) int64 evaluations."""
        return np.isin(evaluations, self.evaluations)

    def promises(self, evaluations: Int64Array) -> Float64Array:
        """Return what behaviors achieve: (k, n) float64 for (n,) int64 evaluations, all of which are known."""
        columns: Float64Array = self.fitness[:, np.searchsorted(self.evaluations, evaluations)]
        return columns
