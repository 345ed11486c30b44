"""Pareto fronts compared with brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pga_me_ros.core.algorithms.qd_rl.selection import pareto_ranks
from pga_me_ros.errors import ArchiveError


def ranks_by_brute_force(points: list[tuple[float, float]]) -> list[int]:
    """Repeatedly remove the points that no remaining point dominates."""
    ranks = [-1] * len(points)
    rank = 0
    while -1 in ranks:
        left = [i for i, r in enumerate(ranks) if r == -1]
        for i in left:
            if not any(dominates(points[j], points[i]) for j in left):
                ranks[i] = rank
        rank += 1
    return ranks


def dominates(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] >= other[0] and one[1] >= other[1] and one != other


few = st.integers(-4, 4).map(float)
any_number = st.floats(allow_nan=False)


@given(st.lists(st.tuples(few, few), max_size=40))
@example([(1.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
@example([(0.0, 2.0), (-0.0, 2.0)])
def test_fronts_with_many_ties_equal_brute_force(points):
    first, second = zip(*points, strict=True) if points else ((), ())
    assert pareto_ranks(first, second).tolist() == ranks_by_brute_force(points)


@given(st.lists(st.tuples(any_number, any_number), max_size=25))
def test_fronts_of_any_numbers_equal_brute_force(points):
    first, second = zip(*points, strict=True) if points else ((), ())
    assert pareto_ranks(first, second).tolist() == ranks_by_brute_force(points)


@pytest.mark.parametrize(
    ("first", "second"), [([1.0], [1.0, 2.0]), ([[1.0]], [[2.0]]), ([np.nan], [1.0])]
)
def test_objectives_of_the_wrong_shape_are_refused(first, second):
    with pytest.raises(ArchiveError, match="without NaN"):
        pareto_ranks(first, second)
