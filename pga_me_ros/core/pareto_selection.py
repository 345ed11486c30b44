"""QD-RL's choice of parents: from the Pareto fronts of fitness and novelty (Cideron et al. 2020)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.errors import ArchiveError
from pga_me_ros.core.novelty import novelty, unit_box
from pga_me_ros.core.pareto import pareto_ranks


def elite_novelty(archive: Archive, neighbors: int) -> NDArray[np.float64]:
    """Return how far each elite's descriptor lies from those of its nearest neighbours, on average.

    Args:
        archive: The elites.
        neighbors: How many neighbours.

    Returns:
        (elites,) float64 in the order of their cells; distances are in shares of the descriptor's range.
    """
    points = unit_box(archive.descriptors[archive.filled], archive.low, archive.high)
    return novelty(points, points, neighbors, themselves=True)


def pareto_parents(
    archive: Archive, neighbors: int, rng: np.random.Generator, n: int
) -> NDArray[np.int64]:
    """Choose the parents of a generation: the best fronts, as many elites as there are offspring.

    Whole fronts as long as there is room; chance decides among the elites of the front for which there is not. With
    fewer elites than offspring all are chosen, each as often as any other or once more. Chance also decides who goes
    where.

    Args:
        archive: Elites to choose from.
        neighbors: Neighbours that an elite's novelty is measured with.
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
