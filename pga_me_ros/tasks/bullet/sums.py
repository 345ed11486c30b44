"""NumPy's arithmetic on plain floats: the same bits, without the cost of small arrays."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from operator import add

import numpy as np

_EIGHT, _FOUR = struct.Struct("8f"), struct.Struct("4f")


def pairwise_sum(values: Sequence[float]) -> float:
    """Return the sum of float64 numbers, added in the order of ``numpy.sum``.

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
    whole = count - count % 8
    sums: Iterable[float] = values[:8]
    for i in range(8, whole, 8):
        sums = map(add, sums, values[i : i + 8])
    a, b, c, d, e, f, g, h = sums
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(whole, count):
        total += values[i]
    return total


class Float32Means:
    """Means of two lists at once, rounded as by ``numpy.mean`` on float32 arrays of their length.

    Args:
        count: Length of the lists, 1 to 8, for which NumPy's order of adding is built in.

    Raises:
        ValueError: `count` is outside 1 to 8.
    """

    def __init__(self, count: int) -> None:
        """Prepare the packing for this length."""
        if not 1 <= count <= 8:
            raise ValueError(f"Float32Means got count {count}; it knows NumPy's order for 1 to 8")
        self._count = count
        # Packing to C floats is the cheapest correct rounding to float32 that Python has.
        self._all = struct.Struct(f"{2 * count}f")
        self._pair = struct.Struct("2f")

    def __call__(self, first: list[float], second: list[float]) -> tuple[float, float]:
        """Return the means of numbers, rounded to float32 before, between and after adding.

        Args:
            first: `count` numbers.
            second: `count` numbers.

        Raises:
            OverflowError: A number or sum is beyond float32.
        """
        count, pair = self._count, self._pair
        v = self._all.unpack(self._all.pack(*first, *second))
        if count == 8:
            # NumPy keeps eight running sums and joins them by pairs, and by pairs of pairs.
            v = _EIGHT.unpack(_EIGHT.pack(*map(add, v[::2], v[1::2])))
            v = _FOUR.unpack(_FOUR.pack(*map(add, v[::2], v[1::2])))
            a, b = pair.unpack(pair.pack(v[0] + v[1], v[2] + v[3]))
        else:
            a, b = v[0], v[count]
            for i in range(1, count):
                a, b = pair.unpack(pair.pack(a + v[i], b + v[count + i]))
        a, b = pair.unpack(pair.pack(a / count, b / count))
        return a, b


def threshold_after_rounding(limit: float) -> float:
    """Return t such that ``x > t`` is equivalent to ``float32(x) > float32(limit)``, for every x.

    Args:
        limit: A positive number.
    """
    rounded = np.float32(limit)
    above = np.nextafter(rounded, np.float32(np.inf))
    middle = (float(rounded) + float(above)) / 2
    return middle if np.float32(middle) == rounded else math.nextafter(middle, 0.0)
