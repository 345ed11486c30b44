"""Random controllers, with which a run starts (Alg. 3 line 10).

Each depends only on the run's seed, its generation and its place in the batch, so any division
of a batch among calls or processes gives the same bits.
"""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings


def random_controllers(
    settings: Settings, shape: MlpShape, generation: int, first: int, count: int
) -> Float32Array:
    """Return random controllers for consecutive places of a batch (Alg. 3 line 10).

    Args:
        settings: Settings of the run.
        shape: Layers of the controllers.
        generation: Their generation.
        first: Place of the first one.
        count: Number of controllers, at least 1.

    Returns:
        (count, P) float32 parameters.
    """
    return np.stack(
        [
            random_parameters(
                shape, generator(settings.seed, Purpose.RANDOM_CONTROLLER, generation, place)
            )
            for place in range(first, first + count)
        ]
    )
