"""Distances between two sets of points, block by block; none depends on what it is computed together with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def squared_distances(
    points: Floats, others: Floats, numbers: int
) -> Iterator[tuple[slice, Floats]]:
    """Yield rows of points and their squared Euclidean distances to all others.

    Args:
        points: (n, d) array.
        others: (m, d) array, m at least 1.
        numbers: Distances at a time, about.

    Yields:
        The rows, and their (rows, m) float64 squared distances.
    """
    columns = np.ascontiguousarray(others.T)
    block = max(1, numbers // len(others))
    for start in range(0, len(points), block):
        part = points[start : start + block]
        squares = np.zeros((len(part), len(others)))
        for axis, column in enumerate(columns):
            difference = part[:, axis, None] - column
            difference *= difference
            squares += difference
        yield slice(start, start + len(part)), squares
