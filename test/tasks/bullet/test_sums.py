"""Arithmetic on plain floats compared with NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.tasks.bullet.sums import Float32Means, pairwise_sum, threshold_after_rounding


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 11, 16, 17, 22, 64, 127, 128])
def test_pairwise_sum_adds_in_numpys_order(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(50):
        values = rng.standard_normal(count) * 10.0 ** rng.integers(-8, 8, count)
        assert pairwise_sum(values.tolist()) == np.repeat(values, 3)[::3].sum()


def test_pairwise_sum_refuses_lengths_that_numpy_would_split() -> None:
    with pytest.raises(ValueError, match="129 values"):
        pairwise_sum([0.0] * 129)


@pytest.mark.parametrize("count", range(1, 9))
def test_float32_means_round_like_numpy(count: int) -> None:
    rng = np.random.default_rng(count)
    means = Float32Means(count)
    for _ in range(200):
        first, second = rng.exponential(1.0, (2, count)) ** 3
        wanted = [float(row.astype(np.float32).mean()) for row in (first, second)]
        assert list(means(first.tolist(), second.tolist())) == wanted


@pytest.mark.parametrize("count", [0, 9])
def test_float32_means_refuse_other_lengths(count: int) -> None:
    with pytest.raises(ValueError, match="1 to 8"):
        Float32Means(count)


@pytest.mark.parametrize("limit", [0.99, 0.1, 1.0 / 3.0, 0.5])
def test_threshold_compares_like_float32(limit: float) -> None:
    threshold = threshold_after_rounding(limit)
    near = threshold + np.arange(-40, 41) * np.spacing(threshold)
    assert ((near > threshold) == (near.astype(np.float32) > np.float32(limit))).all()
