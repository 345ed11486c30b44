"""QD-RL's choice of parents: from the Pareto fronts of fitness and novelty (Cideron et al. 2020)."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.novelty import novelty, unit_box
from pga_me_ros.errors import ArchiveError


def elite_novelty(archive: Archive, neighbors: int) -> Float64Array:
    """Return each elite's mean distance to its nearest neighbors in descriptor space.

    Args:
        archive: The elites.
        neighbors: Number of neighbors.

    Returns:
        (elites,) float64 in the order of their cells; distances are in shares of the descriptor's range.
    """
    points = unit_box(archive.descriptors[archive.filled], archive.low, archive.high)
    return novelty(points, points, neighbors, themselves=True)


def pareto_parents(
    archive: Archive, neighbors: int, rng: np.random.Generator, n: int
) -> Int64Array:
    """Choose the parents of a generation: the best fronts, as many elites as there are offspring.

    Fronts are taken whole, best first; from the one that doesn't fit, elites are drawn at random. With fewer elites
    than offspring, all are chosen, and their numbers of offspring differ by at most one. Their order is random.

    Args:
        archive: Elites to choose from.
        neighbors: Number of neighbors for an elite's novelty.
        rng: Generator of the draws.
        n: Number of parents, at least 1.

    Returns:
        (n,) int64 array of cells.

    Raises:
        ArchiveError: The archive is empty.
    """
    cells = archive.filled_cells()
    if not len(cells):
        raise ArchiveError("The archive is empty; add solutions first.")
    ranks = pareto_ranks(archive.fitness[cells], elite_novelty(archive, neighbors))
    shuffled = rng.permutation(len(cells))
    by_front = shuffled[np.argsort(ranks[shuffled], kind="stable")]
    chosen = np.resize(by_front, n)  # repeats them if there are fewer
    return cells[rng.permutation(chosen)]


def pareto_ranks(first: ArrayLike, second: ArrayLike) -> Int64Array:
    """Return the Pareto front of each point: 0 for non-dominated points, 1 for those dominated by front 0 alone, etc.

    A point dominates another if it is at least as great in both objectives and greater in one; equal points share a
    front. One sweep over descending first objective: a front dominates a point exactly if one of its points swept
    earlier is at least as great in the second objective. The greatest second objective falls from front to front.

    Args:
        first: (n,) numbers.
        second: (n,) numbers.

    Returns:
        (n,) int64 ranks without gaps, 0 the first front.

    Raises:
        ArchiveError: The lengths differ, or a number is NaN.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if a.ndim != 1 or a.shape != b.shape or np.isnan(a).any() or np.isnan(b).any():
        raise ArchiveError(
            f"Objectives have the shapes {a.shape} and {b.shape}; expected two of (n,) without NaN."
        )
    ranks = np.zeros(len(a), np.int64)
    lowered: list[float] = []  # per front, minus the greatest second objective so far: ascending
    last: tuple[float, float] | None = None
    rank = 0
    for i in np.lexsort((-b, -a)).tolist():
        point = (float(a[i]), float(b[i]))
        if point != last:
            # The first front whose greatest is less than this one's second objective does not dominate it.
            rank = bisect_right(lowered, -point[1])
            lowered[rank : rank + 1] = [-point[1]]
            last = point
        ranks[i] = rank
    return ranks
