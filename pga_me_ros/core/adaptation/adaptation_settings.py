"""How the behavior that a damaged robot tries next is chosen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.settings.field import INT64_MAX, setting
from pga_me_ros.errors import SettingsError

SMALLEST_SCALE = 1e-6
"""Smallest length scale that can be computed with."""

SCALES = 5
"""Number of length scales that are averaged."""


@dataclass(frozen=True)
class AdaptationSettings:
    """How behaviors are chosen; the defaults are the paper's."""

    budget: int = setting(20, "Most trials.", low=1, high=INT64_MAX, unit="trials")
    length_scale: float = setting(
        0.4,
        "Distance over which behaviors tell about each other, in shares of the descriptor's range (the paper's rho).",
        low=SMALLEST_SCALE,
        high=1e6,
    )
    least_length_scale: float = setting(
        0.0,
        "If above 0, the length scale is inferred from the trials: several from this one to length_scale are averaged, "
        "each by how well it explains what was achieved.",
        low=0.0,
        high=1e6,
    )
    noise: float = setting(
        0.001,
        "Variance of a trial's noise, in squared shares of the best promise (the paper's sigma_noise²).",
        low=1e-9,
        high=1e3,
    )
    kappa: float = setting(
        0.05,
        "Weight of the uncertainty in the upper confidence bound, in shares of the best promise.",
        low=0.0,
        high=1e3,
    )
    enough: float = setting(
        0.9,
        "Share of the best that is expected anywhere that a trial must reach to be the last one (the paper's alpha).",
        low=0.0,
        high=1.0,
    )
    sound: float = setting(
        0.5,
        "Probability, before the first trial, that the robot is in the world of its repertoire; the other worlds share "
        "the rest. Counts only with worlds.",
        low=1e-6,
        high=1.0,
    )
    spread: float = setting(
        0.3,
        "Standard deviation by which a behavior misses what it achieves in a world, in shares of the best promise. "
        "Counts only with worlds.",
        low=1e-3,
        high=1e3,
    )

    def __post_init__(self) -> None:
        """Check that the least length scale is the lesser one.

        Raises:
            SettingsError: It is not, or too small to compute with.
        """
        least, greatest = self.least_length_scale, self.length_scale
        if least and not SMALLEST_SCALE <= least < greatest:
            raise SettingsError(
                f"least_length_scale is {least:g}; expected 0, or a value from {SMALLEST_SCALE:g} up to below "
                f"length_scale, which is {greatest:g}."
            )

    @property
    def length_scales(self) -> Float64Array:
        """(k,) float64 length scales that count: the one, or several at equal ratios."""
        if not self.least_length_scale:
            return np.array([self.length_scale])
        return np.geomspace(self.least_length_scale, self.length_scale, SCALES)
