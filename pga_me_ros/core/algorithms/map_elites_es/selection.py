"""Where MAP-Elites-ES starts its next steps: biased sampling of cells (Colas et al. 2020), as probabilities."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array

RECENT = 5
"""Cells whose elites changed last: an exploit start comes from the best of them, or from the best cell of all."""

BEST_OF_RECENT = 2
"""How many of those cells may be drawn."""

MOST_NOVEL = 5
"""Cells that an explore start mostly comes from."""

UNIFORM_SHARE = 0.1
"""Share of explore starts that come from any cell."""


def exploit_probabilities(fitness: Float64Array, changed: Int64Array) -> Float64Array:
    """Return how likely exploit steps start from each cell.

    In half of the cases from the fittest elite; else from one of the two fittest of the five that changed last, in
    proportion to how much fitter they are than the least fit of all, plus 1. Below five elites always from the fittest.

    Args:
        fitness: (m,) float64 fitness of the elites, m at least 1.
        changed: (m,) int64 when each elite came to its cell; all different.

    Returns:
        (m,) float64 that add up to 1.
    """
    best = _best(fitness)
    if len(fitness) < RECENT:
        return best
    recent = np.argsort(changed)[-RECENT:]
    two = recent[np.argsort(-fitness[recent], kind="stable")[:BEST_OF_RECENT]]
    scores = np.zeros(len(fitness))
    scores[two] = fitness[two] - fitness.min() + 1.0
    return 0.5 * best + 0.5 * scores / scores.sum()


def explore_probabilities(novelty: Float64Array) -> Float64Array:
    """Return how likely explore steps start from each cell.

    Nine of ten starts come from the five most novel elites, in proportion to their novelty, the others from any cell.

    Args:
        novelty: (m,) float64 novelty of the elites, m at least 1, none negative.

    Returns:
        (m,) float64 that add up to 1.
    """
    count = len(novelty)
    scores = np.zeros(count)
    most = np.argsort(-novelty, kind="stable")[:MOST_NOVEL]
    scores[most] = novelty[most]
    if not scores.any():
        return np.full(count, 1.0 / count)
    return UNIFORM_SHARE / count + (1.0 - UNIFORM_SHARE) * scores / scores.sum()


def plain_probabilities(fitness: Float64Array) -> Float64Array:
    """Return how likely a start is from each cell without bias to novelty: half from the fittest elite, half from any.

    Args:
        fitness: (m,) float64 fitness of the elites, m at least 1.

    Returns:
        (m,) float64 that add up to 1.
    """
    return 0.5 * _best(fitness) + 0.5 / len(fitness)


def _best(fitness: Float64Array) -> Float64Array:
    best = np.zeros(len(fitness))
    best[fitness.argmax()] = 1.0
    return best
