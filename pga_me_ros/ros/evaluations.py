"""What evaluators are asked for, and what they answer, in messages."""

from __future__ import annotations

import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.convert import finite, flat, shaped


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


def aims_to_msg(intended: Float64Array) -> array.array[Any]:
    """Return intended descriptors as a field: nothing where no controller has one.

    Args:
        intended: (n, descriptor_dim) float64, a row of NaN for a controller that has none.
    """
    return flat(() if np.isnan(intended).all() else intended, "d")


def aims_from_msg(data: Any, n: int, descriptor_dim: int) -> list[Float64Array | None]:
    """Return the intended descriptor of each of n controllers, None for none; see `aims_to_msg`.

    Raises:
        RequestError: The field has the wrong length, or a row holds infinity, or NaN in some of its entries only.
    """
    if not len(data):
        return [None] * n
    rows = shaped(data, (n, descriptor_dim), np.float64, "intended_descriptors")
    return [None if np.isnan(r).all() else finite(r, "intended_descriptors") for r in rows]


def require_minimum(name: str, values: NDArray[Any], minimum: int) -> None:
    """Make sure that no entry of a field is too small.

    Raises:
        RequestError: One is.
    """
    if values.min() < minimum:
        raise RequestError(f"Field '{name}' holds {values.min()}; expected {minimum} or more.")
