"""Novelty compared with SciPy's nearest neighbors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pga_me_ros.core.archive.novelty import nearest_distance, novelty, unit_box
from pga_me_ros.errors import ArchiveError


def points(n: int, d: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((n, d))


def trees_mean(tree: cKDTree, wanted: np.ndarray, k: int) -> np.ndarray:
    return tree.query(wanted, k)[0].reshape(len(wanted), -1).mean(axis=1)


@settings(deadline=None)
@given(st.integers(1, 4), st.integers(1, 60), st.integers(1, 80), st.integers(1, 12), st.integers())
def test_novelty_is_the_mean_distance_to_the_nearest(d, n, m, k, seed):
    seed = abs(seed)
    asked, others = points(n, d, seed), points(m, d, seed + 1)
    expected = trees_mean(cKDTree(others), asked, min(k, m))
    np.testing.assert_allclose(novelty(asked, others, k), expected, rtol=1e-12)


@pytest.mark.parametrize("k", [1, 5, 70])
def test_no_point_is_its_own_neighbor(k):
    own = points(50, 3)
    own[7] = own[3]  # an equal point is a different one, and may be a neighbor
    distances = cKDTree(own).query(own, min(k, 49) + 1)[0][:, 1:]
    np.testing.assert_allclose(
        novelty(own, own, k, themselves=True), distances.mean(axis=1), rtol=1e-12
    )


def test_large_sets_of_several_blocks():
    asked, others = points(700, 2), points(900, 2, 1)
    expected = trees_mean(cKDTree(others), asked, 10)
    np.testing.assert_allclose(novelty(asked, others, 10), expected, rtol=1e-12)
    own = trees_mean(cKDTree(asked), asked, 11) * 11 / 10  # the first of them at distance 0
    np.testing.assert_allclose(novelty(asked, asked, 10, themselves=True), own, rtol=1e-12)


def test_the_result_for_a_point_does_not_depend_on_other_points():
    asked, others = points(300, 4), points(2000, 4, 1)
    together = novelty(asked, others, 7)
    alone = np.concatenate([novelty(p[None], others, 7) for p in asked])
    assert together.tobytes() == alone.tobytes()


@pytest.mark.parametrize(("own", "others"), [(3, 0), (0, 3)])
def test_without_neighbors_novelty_is_zero(own, others):
    np.testing.assert_array_equal(novelty(points(own, 2), points(others, 2), 5), np.zeros(own))
    assert novelty(points(1, 2), points(1, 2), 5, themselves=True).tolist() == [0.0]


def test_nearest_distance_equals_scipys():
    asked, others = points(500, 3), points(600, 3, 1)
    np.testing.assert_allclose(nearest_distance(asked, others), cKDTree(others).query(asked)[0])
    assert np.isinf(nearest_distance(asked, points(0, 3))).all()


def test_dimensions_are_weighted_by_their_range():
    scaled = unit_box([[2.0, -5.0], [4.0, 5.0], [1.0, 9.0]], [2.0, -10.0], [6.0, 10.0])
    np.testing.assert_allclose(scaled, [[0.0, 0.25], [0.5, 0.75], [0.0, 0.95]])


def test_bounds_that_are_not_a_box_are_refused():
    with pytest.raises(ArchiveError, match="bounds"):
        unit_box([[0.0]], [1.0], [1.0])
