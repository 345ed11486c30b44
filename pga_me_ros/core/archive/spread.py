"""A few elites of an archive that differ as much as possible."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.elite_table import EliteTable


def spread_cells(elites: EliteTable, cells: Int64Array, count: int) -> list[int]:
    """Return cells whose elites lie far from each other, in the order of their descriptors.

    The first one chosen is the fittest; each further one has the greatest distance to those before, each dimension in
    shares of its range.

    Args:
        elites: The archive, or its elites as their means tell them.
        cells: Filled cells to choose from, at least one.
        count: Most cells to return.
    """
    points = elites.descriptors[cells] / elites.extent
    chosen = [int(np.argmax(elites.fitness[cells]))]
    apart = _distances(points, chosen[0])
    while len(chosen) < min(count, len(cells)) and apart.max() > 0.0:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, _distances(points, chosen[-1]))
    order = sorted(chosen, key=lambda k: tuple(points[k]))
    return [int(cells[k]) for k in order]


def _distances(points: Float64Array, k: int) -> Float64Array:
    distances: Float64Array = np.linalg.norm(points - points[k], axis=1)
    return distances
