"""The weight of a reward, given achieved and intended descriptor (DCRL-MAP-Elites, Faldor et al. 2025)."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float64Array


def similarity(achieved: Float64Array, intended: Float64Array, length: float) -> Float64Array:
    """Return S(d, d') = exp(-|d - d'| / l), with the Euclidean norm.

    Args:
        achieved: (..., d) float64 descriptors scaled to ±1 (`networks.conditioned.scaled`).
        intended: (..., d) float64, scaled in the same way.
        length: l, the distance at which the similarity is 1/e.

    Returns:
        (...) float64 above 0, 1 where the two are equal.
    """
    distance = np.sqrt(((achieved - intended) ** 2).sum(axis=-1))
    return np.exp(-distance / length)
