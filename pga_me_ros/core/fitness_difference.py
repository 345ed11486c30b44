"""Fitness difference: what the best controller of a generation was lucky by (section 4.4, Nilsson & Cully 2021)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.metrics import Metrics
from pga_me_ros.core.reevaluations import Reevaluations

REPEATS = 10
"""Evaluations that the single one is compared with."""


def fitness_differences(
    metrics: Sequence[Metrics], rows: Reevaluations, repeats: int = REPEATS
) -> NDArray[np.float64]:
    """Return, for every generation, the best elite's fitness minus the mean of its re-evaluations.

    The repeats 0 to `repeats` - 1 count and no others, so that all runs are measured alike.

    Args:
        metrics: Metrics of every generation.
        rows: Re-evaluations of the controllers that were the best ones (``reevaluate RUN --bests``).
        repeats: Number of re-evaluations per controller.

    Returns:
        (generations,) float64; NaN where the best one is not known or was not re-evaluated as often.
    """
    found: dict[int, dict[int, float]] = {}
    for evaluation, repeat, fitness in zip(
        rows.evaluation.tolist(), rows.repeat.tolist(), rows.fitness.tolist(), strict=True
    ):
        if repeat < repeats:
            found.setdefault(evaluation, {})[repeat] = fitness
    means = {
        evaluation: math.fsum(fitness.values()) / repeats
        for evaluation, fitness in found.items()
        if len(fitness) == repeats
    }
    return np.array(
        [m.max_fitness - means.get(m.best_evaluation, math.nan) for m in metrics], np.float64
    )
