"""Directional variation, the genetic operator of Alg. 5 (Eq. 6, Nilsson & Cully 2021)."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import SettingsError


def ga_variation(
    parent1: Float32Array,
    parent2: Float32Array,
    iso_sigma: float,
    line_sigma: float,
    rng: np.random.Generator,
    shape: MlpShape,
    line_noise: str = "scalar",
) -> Float32Array:
    """Return phi_1 + sigma_1 N(0, I) + sigma_2 (phi_2 - phi_1) N(0, 1), Eq. 6.

    Args:
        parent1: (P,) float32, phi_1: the parent that the offspring lies near.
        parent2: (P,) float32, phi_2: gives the line.
        iso_sigma: sigma_1, standard deviation of the isotropic noise.
        line_sigma: sigma_2, standard deviation of the step along the line.
        rng: Source of the draws.
        shape: Layers of the controllers.
        line_noise: 'scalar' draws one step along the line (paper), 'tensor' one for each weight and
            bias tensor (as coded by the authors).

    Returns:
        (P,) float32 offspring.

    Raises:
        NetworkError: A parent does not fit the layers.
        SettingsError: line_noise is neither 'scalar' nor 'tensor'.
    """
    shape.check(parent1)
    shape.check(parent2)
    offspring = rng.standard_normal(len(parent1), np.float32)
    offspring *= np.float32(iso_sigma)
    offspring += parent1
    step = parent2 - parent1
    step *= _line_draws(shape, rng, line_noise) * np.float32(line_sigma)
    offspring += step
    return offspring


def _line_draws(shape: MlpShape, rng: np.random.Generator, line_noise: str) -> Float32Array:
    if line_noise == "scalar":
        return rng.standard_normal(1, np.float32)
    if line_noise == "tensor":
        sizes = [tensor.size for tensor in shape.slices()]
        return np.repeat(rng.standard_normal(len(sizes), np.float32), sizes)
    raise SettingsError(f"line_noise is {line_noise!r}; it must be 'scalar' or 'tensor'.")


def ga_offspring(
    settings: Settings, shape: MlpShape, generation: int, first: int, parents: Float32Array
) -> Float32Array:
    """Return GA offspring for consecutive places of a batch (Eq. 6).

    Args:
        settings: Settings with the rates in force.
        shape: Layers of the controllers.
        generation: Generation of the offspring.
        first: Place of the first one.
        parents: (n, 2, P) float32 parameters.

    Returns:
        (n, P) float32 parameters.

    Raises:
        NetworkError: A parent does not fit the layers.
    """
    return np.stack(
        [
            ga_variation(
                parent_a,
                parent_b,
                settings.iso_sigma,
                settings.line_sigma,
                generator(settings.seed, Purpose.GA_VARIATION, generation, first + i),
                shape,
                settings.line_noise,
            )
            for i, (parent_a, parent_b) in enumerate(parents)
        ]
    )
