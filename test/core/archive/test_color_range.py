"""The color scale of an archive: outliers don't take it, everything else does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pga_me_ros.core.archive.color_range import SHARE, color_range

EVEN = [float(i) for i in range(101)]
VALUES = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=200)


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        ([], (0.0, 1.0)),
        ([7.0], (7.0, 7.0)),
        ([0.0, 1e9], (0.0, 1e9)),
        (EVEN, (0.0, 100.0)),
        ([*EVEN, 225.0], (0.0, 225.0)),  # far, but no outlier
        ([*EVEN, 1e6], (0.0, 229.0)),
        ([*EVEN, -1e6], (-129.0, 100.0)),
        ([*EVEN, -1e6, 1e6], (-132.0, 232.0)),
        ([*EVEN, *[1e6] * 9], (0.0, 1e6)),  # too many to be outliers
        ([5.0] * 50 + [6.0], (5.0, 6.0)),  # no spread to judge by
        ([1.0, 2.0, 3.0, 4.0, 1e4], (1.0, 10.0)),
    ],
)
def test_outliers_lie_beyond_the_scale(values: list[float], scale: tuple[float, float]) -> None:
    assert color_range(np.array(values)) == pytest.approx(scale)


@given(VALUES)
def test_the_scale_is_within_the_values_and_few_are_beyond_it(values: list[float]) -> None:
    low, high = color_range(np.array(values))
    assert min(values) <= low <= high <= max(values)
    few = max(1, SHARE * len(values))
    assert sum(value < low for value in values) <= few
    assert sum(value > high for value in values) <= few


@given(VALUES)
def test_a_mirrored_archive_has_the_mirrored_scale(values: list[float]) -> None:
    low, high = color_range(np.array(values))
    assert color_range(-np.array(values)) == (-high, -low)
