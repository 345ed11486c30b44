"""Cells that MAP-Elites-ES restarts from: biased sampling (Colas et al. 2020), as probabilities."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array

RECENT = 5
"""Most recently changed cells considered: an exploit start comes from the best of them or the best cell of all."""

BEST_OF_RECENT = 2
"""Number of those cells that may be drawn."""

MOST_NOVEL = 5
"""Cells that an explore start mostly comes from."""

UNIFORM_SHARE = 0.1
"""Share of explore starts that come from any cell."""


def exploit_probabilities(fitness: Float64Array, changed: Int64Array) -> Float64Array:
    """Return the probability that exploit steps start from each cell.

    Half of the starts come from the fittest elite, the others from one of the two fittest of the five that changed
    last, in proportion to fitness minus the least fitness of all, plus 1. With fewer than five elites, all come from
    the fittest.

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
    """Return the probability that explore steps start from each cell.

    Nine of ten starts come from the five most novel elites, in proportion to their novelty; the others from any cell.

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
    """Return the probability of each cell without a novelty bias: half for the fittest elite, half uniform.

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
