"""What adaptation is compared with, at an equal number of trials: elites at random, and learning from the best one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pga_me_ros.arrays import Float32Array

STEP = 0.05
"""Standard deviation of a hill climber's change of each parameter."""


def random_search(
    cells: Sequence[int],
    trials: int,
    attempt: Callable[[int], float],
    rng: np.random.Generator,
) -> int:
    """Try behaviors at random, none twice, and return the cell of the one that achieved most.

    Args:
        cells: Cells to draw from.
        trials: Number of trials, at most all cells.
        attempt: Tries the behavior of a cell and returns what it achieved.
        rng: Source of the draw.
    """
    drawn = rng.permutation(np.asarray(cells))[:trials].tolist()
    return int(max(drawn, key=attempt))


def hill_climb(
    parameters: Float32Array,
    trials: int,
    attempt: Callable[[Float32Array], float],
    rng: np.random.Generator,
    step: float = STEP,
) -> Float32Array:
    """Change a controller at random, keep what is better, and return the best.

    Args:
        parameters: (P,) float32 parameters to begin with; trying them is the first trial.
        trials: Number of trials.
        attempt: Tries parameters and returns what they achieved.
        rng: Source of the changes.
        step: Standard deviation of the change of each parameter.

    Returns:
        (P,) float32.
    """
    best, achieved = parameters, attempt(parameters)
    for _ in range(trials - 1):
        change = rng.standard_normal(best.size, np.float32) * np.float32(step)
        other = best + change
        result = attempt(other)
        if result > achieved:
            best, achieved = other, result
    return best
