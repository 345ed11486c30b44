"""Centroids: evenly spread, reproducible, and as good as another implementation's."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree

from pga_me_ros.core.archive.cvt import cvt_centroids
from pga_me_ros.core.archive.geometry import nearest_centroids, nearest_centroids_on_raster
from pga_me_ros.core.archive.grid import grid_centroids
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.errors import ArchiveError

PRINT_DIGEST = """
import hashlib
from pga_me_ros.core.archive.cvt import cvt_centroids
from pga_me_ros.core.rng import Purpose, generator
rng = generator(0, Purpose.CENTROIDS, 0, 64)
print(hashlib.sha256(cvt_centroids(64, [0, 0], [1, 1], 5000, rng).tobytes()).hexdigest())
"""


def _centroids(cells: int, dimensions: int, samples: int, **box: list[float]) -> np.ndarray:
    low = box.get("low", [0.0] * dimensions)
    high = box.get("high", [1.0] * dimensions)
    return cvt_centroids(cells, low, high, samples, generator(0, Purpose.CENTROIDS, 0, cells))


def _error(points: np.ndarray, centroids: np.ndarray) -> float:
    distance, _ = cKDTree(centroids).query(points)
    return float((distance**2).mean())


@pytest.mark.parametrize("dimensions", [1, 2, 4])
def test_centroids_quantize_as_well_as_scipys(dimensions: int) -> None:
    ours = _centroids(100, dimensions, 20_000)
    rng = np.random.default_rng(1)
    points, unseen = rng.random((2, 20_000, dimensions))
    theirs, _ = kmeans2(points, 100, iter=40, minit="++", seed=2)
    assert _error(unseen, ours) < 1.03 * _error(unseen, theirs)


def test_centroids_lie_in_the_box() -> None:
    low, high = [-3.0, 10.0], [-1.0, 10.5]
    centroids = _centroids(50, 2, 2000, low=low, high=high)
    assert ((centroids >= low) & (centroids <= high)).all()


def test_centroids_span_the_box() -> None:
    centroids = _centroids(50, 2, 2000, low=[-3.0, 10.0], high=[-1.0, 10.5])
    np.testing.assert_allclose(np.ptp(centroids, axis=0), [2.0, 0.5], rtol=0.2)


def test_centroids_are_the_means_of_their_samples() -> None:
    samples = generator(0, Purpose.CENTROIDS, 0, 40).random((4000, 2))
    centroids = _centroids(40, 2, 4000)
    labels = cKDTree(centroids).query(samples)[1]
    means = np.stack([samples[labels == cell].mean(axis=0) for cell in range(40)])
    np.testing.assert_allclose(centroids, means, atol=5e-3)


def test_with_as_many_cells_as_samples_every_sample_is_a_centroid() -> None:
    samples = generator(0, Purpose.CENTROIDS, 0, 30).random((30, 2))
    np.testing.assert_array_equal(np.sort(_centroids(30, 2, 30), axis=0), np.sort(samples, axis=0))


def test_centroids_are_equal_in_processes_with_other_thread_counts() -> None:
    digests = {
        subprocess.run(
            [sys.executable, "-c", PRINT_DIGEST],
            env=os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2")
    }
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("cells", "low", "high", "samples", "message"),
    [
        (0, [0.0], [1.0], 10, "0 cells"),
        (11, [0.0], [1.0], 10, "11 cells"),
        (5, [0.0], [0.0], 10, "lower one below"),
        (5, [0.0], [np.inf], 10, "finite"),
        (5, [0.0, 0.0], [1.0], 10, "same length"),
        (5, [], [], 10, "at least one"),
    ],
)
def test_impossible_tessellations_are_refused(
    cells: int, low: list[float], high: list[float], samples: int, message: str
) -> None:
    with pytest.raises(ArchiveError, match=message):
        cvt_centroids(cells, low, high, samples, np.random.default_rng(0))


def test_grid_centroids_are_bin_centers_with_the_last_dimension_fastest() -> None:
    expected = [[0.25, -0.5], [0.25, 0.5], [0.75, -0.5], [0.75, 0.5]]
    np.testing.assert_allclose(grid_centroids([2, 2], [0, -1], [1, 1]), expected)


@pytest.mark.parametrize("bins", [[3], [3, 0], [3, 3, 3]])
def test_bins_that_do_not_fit_the_box_are_refused(bins: list[int]) -> None:
    with pytest.raises(ArchiveError, match="bins are"):
        grid_centroids(bins, [0, 0], [1, 1])


def test_nearest_centroid_agrees_with_a_tree() -> None:
    rng = np.random.default_rng(0)
    centroids, points = rng.random((300, 4)), rng.random((5000, 4))
    expected = cKDTree(centroids).query(points)[1]
    np.testing.assert_array_equal(nearest_centroids(points, centroids), expected)


def test_ties_go_to_the_lowest_index() -> None:
    centroids = np.array([[1.0], [0.0], [0.5], [0.0]])
    assert nearest_centroids(np.array([[0.25], [0.0], [0.75]]), centroids).tolist() == [1, 1, 0]


@pytest.mark.parametrize("cells", [1, 30, 5000])
@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (7, 90), (61, 40)])
def test_a_raster_has_the_nearest_centroids_of_its_points(
    cells: int, columns: int, rows: int
) -> None:
    rng = np.random.default_rng(cells)
    centroids = np.round(rng.random((cells, 2)), 2)  # many are equal: ties
    x, y = (np.arange(columns) + 0.5) / columns, (np.arange(rows)[::-1] + 0.5) / rows
    points = np.stack([np.tile(x, rows), np.repeat(y, columns)], axis=1)
    expected = nearest_centroids(points, centroids).reshape(rows, columns)
    np.testing.assert_array_equal(nearest_centroids_on_raster(x, y, centroids), expected)
