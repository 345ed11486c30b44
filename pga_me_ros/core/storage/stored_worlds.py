"""Worlds that elites were re-evaluated in, from the files of ``reevaluate --randomization``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.worlds import Worlds
from pga_me_ros.core.storage.reevaluations import Reevaluations


def worlds_of(elsewhere: Sequence[Reevaluations]) -> Worlds | None:
    """Return the worlds of some files of re-evaluations, None if no elite is in all of them.

    Each repeat is a world: all elites have the same initial pose in it, and masses and the like are drawn alike. Where
    some elites were evaluated more often than others, the further repeats don't count.

    Args:
        elsewhere: Re-evaluations in which other things were randomized than in the run.
    """
    tables = [_table(rows) for rows in elsewhere if rows.evaluation.size]
    if not tables:
        return None
    evaluations = tables[0][0]
    for others, _ in tables[1:]:
        evaluations = np.intersect1d(evaluations, others)
    if not evaluations.size:
        return None
    fitness = [table[:, np.searchsorted(own, evaluations)] for own, table in tables]
    return Worlds(evaluations, np.concatenate(fitness))


def _table(rows: Reevaluations) -> tuple[Int64Array, Float64Array]:
    """Return (m,) int64 evaluations of the elites, ascending, and (k, m) float64 fitness in their common repeats."""
    evaluations, columns, counts = np.unique(
        rows.evaluation, return_inverse=True, return_counts=True
    )
    table = np.full((int(counts.min()), len(evaluations)), np.nan)
    common = rows.repeat < len(table)
    table[rows.repeat[common], columns[common]] = rows.fitness[common]
    complete = ~np.isnan(table).any(axis=0)
    return evaluations[complete], table[:, complete]
