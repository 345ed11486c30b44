"""NumPy's arithmetic on plain floats: the same bits, without the cost of small arrays."""

from __future__ import annotations

import math

import numpy as np


def pairwise_sum(values: list[float]) -> float:
    """Return the sum of float64 numbers in the order in which ``numpy.sum`` adds a 1-D array of up to 128.

    Args:
        values: At most 128 floats; NumPy splits longer arrays.

    Raises:
        ValueError: There are more than 128 values.
    """
    count = len(values)
    if count > 128:
        raise ValueError(f"pairwise_sum got {count} values; it knows NumPy's order up to 128")
    if count < 8:
        total = 0.0
        for value in values:
            total += value
        return total
    a, b, c, d, e, f, g, h = values[:8]
    whole = count - count % 8
    for i in range(8, whole, 8):
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
        e += values[i + 4]
        f += values[i + 5]
        g += values[i + 6]
        h += values[i + 7]
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(whole, count):
        total += values[i]
    return total


def threshold_after_rounding(limit: float) -> float:
    """Return t such that ``x > t`` in float64 says what ``float32(x) > float32(limit)`` does, for every x.

    Args:
        limit: A positive number.
    """
    rounded = np.float32(limit)
    above = np.nextafter(rounded, np.float32(np.inf))
    middle = (float(rounded) + float(above)) / 2
    return middle if np.float32(middle) == rounded else math.nextafter(middle, 0.0)
