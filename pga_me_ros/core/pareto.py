"""Pareto fronts of two objectives, both to be great."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pga_me_ros.core.errors import ArchiveError


def pareto_ranks(first: ArrayLike, second: ArrayLike) -> NDArray[np.int64]:
    """Return the front that each point belongs to: 0 for those that no other dominates, and so on without them.

    A point dominates another if it is at least as great in both objectives and greater in one; equal points share a
    front. One sweep by falling first objective: a point is dominated by a front exactly if some point of it that was
    swept before is at least as great in the second, and the greatest second objective falls from front to front.

    Args:
        first: (n,) numbers.
        second: (n,) numbers.

    Returns:
        (n,) int64 ranks without gaps, 0 the first front.

    Raises:
        ArchiveError: The lengths differ, or a number is NaN.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if a.ndim != 1 or a.shape != b.shape or np.isnan(a).any() or np.isnan(b).any():
        raise ArchiveError(
            f"Objectives have the shapes {a.shape} and {b.shape}; expected two of (n,) without NaN."
        )
    ranks = np.zeros(len(a), np.int64)
    lowered: list[
        float
    ] = []  # of each front, minus the greatest second objective so far: ascending
    last: tuple[float, float] | None = None
    rank = 0
    for i in np.lexsort((-b, -a)).tolist():
        point = (float(a[i]), float(b[i]))
        if point != last:
            # The first front whose greatest is less than this one's second objective does not dominate it.
            rank = bisect_right(lowered, -point[1])
            lowered[rank : rank + 1] = [-point[1]]
            last = point
        ranks[i] = rank
    return ranks
