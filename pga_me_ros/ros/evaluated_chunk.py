"""Results of several evaluations in a message, as evaluators and the generation loop send them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.ros.convert import finite, shaped


@dataclass(frozen=True)
class EvaluatedChunk:
    """Results of a chunk of evaluations.

    Attributes:
        fitness: (n,) float64.
        descriptors: (n, descriptor_dim) float64.
        steps: (n,) int64 lengths of the episodes [control steps].
        terminated: (n,) bool.
    """

    fitness: Float64Array
    descriptors: Float64Array
    steps: Int64Array
    terminated: BoolArray


def evaluated_from_msg(msg: Any, n: int, descriptor_dim: int) -> EvaluatedChunk:
    """Read fitness, descriptors, steps and terminated of n solutions from a request or response.

    Raises:
        RequestError: A field has the wrong length or holds NaN or infinity.
    """
    return EvaluatedChunk(
        fitness=finite(shaped(msg.fitness, (n,), np.float64, "fitness"), "fitness"),
        descriptors=finite(
            shaped(msg.descriptors, (n, descriptor_dim), np.float64, "descriptors"), "descriptors"
        ),
        steps=shaped(msg.steps, (n,), np.int64, "steps"),
        terminated=shaped(msg.terminated, (n,), np.bool_, "terminated"),
    )
