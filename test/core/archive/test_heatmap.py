"""Pictures of archives: the right color in the right place, in a file that others can read."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Elite, Solutions
from pga_me_ros.core.archive.grid import GridArchive, grid_centroids
from pga_me_ros.core.archive.heatmap import ANCHORS, EMPTY, draw_heatmap
from pga_me_ros.core.operators import Operator
from pga_me_ros.errors import ArchiveError

DARK, BRIGHT = ANCHORS[0], ANCHORS[-1]


def filled(archive: Archive, descriptors: list[list[float]], fitness: list[float]) -> Archive:
    n = len(fitness)
    archive.add(
        Solutions.of(
            fitness=fitness,
            descriptors=descriptors,
            parameters=np.zeros((n, 1)),
            evaluations=range(n),
        )
    )
    return archive


def elite_of(cell: int, descriptor: np.ndarray, fitness: float) -> Elite:
    parameters = np.zeros(1, np.float32)
    return Elite(cell, fitness, descriptor, parameters, cell, 0, Operator.GA, -1, -1, 1, False)


def cvt(dimensions: int, bins: int) -> CvtArchive:
    low, high = [0.0] * dimensions, [1.0] * dimensions
    return CvtArchive(grid_centroids([bins] * dimensions, low, high), low, high, 1)


def grid(dimensions: int, bins: int) -> GridArchive:
    return GridArchive([bins] * dimensions, [0.0] * dimensions, [1.0] * dimensions, 1)


@pytest.mark.parametrize("make", [cvt, grid])
def test_the_first_descriptor_grows_right_and_the_second_up(make) -> None:
    image = draw_heatmap(filled(make(2, 10), [[0.05, 0.05], [0.95, 0.05]], [0.0, 1.0]), 100)
    corners = [tuple(image[y, x]) for y, x in ((99, 0), (99, 99), (0, 0), (0, 99))]
    assert corners == [DARK, BRIGHT, EMPTY, EMPTY]


@pytest.mark.parametrize("make", [cvt, grid])
def test_each_cell_has_its_share_of_pixels(make) -> None:
    image = draw_heatmap(filled(make(2, 10), [[0.55, 0.35]], [1.0]), 100)
    lit = (image != EMPTY).any(axis=2)
    assert lit[60:70, 50:60].all()
    assert lit.sum() == 100


def test_every_pixel_of_a_tessellation_shows_the_nearest_cell() -> None:
    rng = np.random.default_rng(0)
    centroids = rng.random((20, 2))
    archive = CvtArchive(centroids, [0, 0], [1, 1], 1)
    filled(archive, centroids.tolist(), list(range(20)))
    image = draw_heatmap(archive, 40)
    shown = [tuple(image[39 - int(y * 40), int(x * 40)]) for x, y in centroids]
    brightness = np.array(shown).sum(axis=1)
    assert (np.diff(brightness) > 0).all()


@pytest.mark.parametrize("make", [cvt, grid])
def test_one_dimension_is_shown_as_columns(make) -> None:
    image = draw_heatmap(filled(make(1, 10), [[0.35], [0.95]], [0.0, 1.0]), 100)
    assert [tuple(image[0, x]) for x in (0, 35, 95)] == [EMPTY, DARK, BRIGHT]


def test_a_cell_narrower_than_a_pixel_is_still_visible() -> None:
    image = draw_heatmap(filled(cvt(1, 1000), [[0.5005]], [1.0]), 100)
    assert tuple(image[0, 50]) == BRIGHT


@pytest.mark.parametrize("make", [cvt, grid])
def test_four_dimensions_are_nested_maps(make) -> None:
    # Outer column 5 of 6, outer row 1; inner column 2, inner row 4; rows count from the bottom.
    descriptor = (np.array([5, 1, 2, 4]) + 0.5) / 6
    image = draw_heatmap(filled(make(4, 6), [descriptor.tolist()], [1.0]), 360)
    lit = np.argwhere((image == BRIGHT).all(axis=2))
    column, row = 5 * 6 + 2, 1 * 6 + 4
    bottom, left = 360 - 10 * row, 10 * column
    assert (lit.min(axis=0), lit.max(axis=0)) == (
        pytest.approx([bottom - 10, left]),
        pytest.approx([bottom - 1, left + 9]),
    )


def test_a_given_scale_is_kept() -> None:
    image = draw_heatmap(filled(grid(1, 10), [[0.05]], [5.0]), 100, low=5.0, high=10.0)
    assert tuple(image[0, 0]) == DARK


def test_colors_tell_elites_apart_beside_an_outlier() -> None:
    descriptors = [[(i + 0.5) / 100] for i in range(100)]
    fitness = [float(i) for i in range(99)]
    image = draw_heatmap(filled(grid(1, 100), descriptors, [*fitness, 1e6]), 100)
    assert len({tuple(color) for color in image[0, :99].tolist()}) > 50
    assert tuple(image[0, 99]) == BRIGHT


def test_an_empty_archive_is_all_gray() -> None:
    assert (draw_heatmap(cvt(2, 4), 20) == EMPTY).all()


def test_brightness_grows_with_fitness() -> None:
    descriptors = [[(i + 0.5) / 100] for i in range(100)]
    image = draw_heatmap(filled(grid(1, 100), descriptors, list(range(100))), 100)
    luminance = image[0] @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luminance) > 0).all()


FEW = ((1,), (1, 1), (7, 1, 30), (6,) * 4, (2,) * 16, (1,) * 12)
MANY = ((1000,), (5000,), (1000, 2), (2, 1000), (2000, 2000), (50, 50, 50), (3, 700, 3, 2))


@pytest.mark.parametrize("bins", [*FEW, *MANY], ids=str)
@pytest.mark.parametrize("width", [1, 35, 240])
def test_any_grid_is_drawn_within_its_width_with_all_its_elites(bins, width) -> None:
    dimensions = len(bins)
    archive = GridArchive(bins, [-1.0] * dimensions, [3.0] * dimensions, 1)
    descriptors = np.random.default_rng(1).uniform(-1, 3, (40, dimensions))
    image = draw_heatmap(filled(archive, descriptors.tolist(), list(range(40))), width)
    assert image.shape[1] <= width
    assert image.shape[0] <= max(1, width if dimensions > 1 else width // 4)
    assert (image == BRIGHT).all(axis=2).any()


@pytest.mark.parametrize("cells", [1, 3, 1500])
@pytest.mark.parametrize("dimensions", [1, 2, 3, 7, 12, 40, 70])
def test_any_tessellation_is_drawn_within_its_width(dimensions, cells) -> None:
    rng = np.random.default_rng(2)
    low, high = [-1.0] * dimensions, [1e3] * dimensions
    archive = CvtArchive(rng.uniform(-1, 1e3, (cells, dimensions)), low, high, 1)
    filled(archive, archive.centroids.tolist(), list(range(cells)))
    image = draw_heatmap(archive, 120)
    assert image.shape[1] <= 120
    assert image.shape[0] <= 120
    assert (image == BRIGHT).all(axis=2).any()


@pytest.mark.parametrize("make", [cvt, grid])
def test_a_pixel_that_cells_share_shows_the_fittest(make) -> None:
    archive = filled(make(1, 1000), [[0.5005], [0.5015], [0.9]], [1.0, 0.0, 0.5])
    image = draw_heatmap(archive, 100)
    assert tuple(image[0, 50]) == BRIGHT
    assert (image[0] != EMPTY).any(axis=1).sum() == 2


def test_bins_of_two_dimensions_that_share_a_pixel_keep_their_place() -> None:
    archive = GridArchive([1000, 2], [0, 0], [1, 1], 1)
    image = draw_heatmap(filled(archive, [[0.0, 0.9], [0.999, 0.1]], [0.0, 1.0]), 100)
    corners = [tuple(image[y, x]) for y, x in ((0, 0), (49, 0), (50, 0), (99, 99))]
    assert corners == [DARK, DARK, EMPTY, BRIGHT]


def test_fitness_with_an_infinite_range_is_shown() -> None:
    archive = filled(grid(1, 10), [[0.05], [0.55], [0.95]], [-1.5e308, 0.0, 1.5e308])
    image = draw_heatmap(archive, 100)
    assert [tuple(image[0, x]) for x in (5, 55, 95)] == [DARK, ANCHORS[2], BRIGHT]


def test_a_width_of_zero_is_refused() -> None:
    with pytest.raises(ArchiveError, match="at least one pixel"):
        draw_heatmap(grid(4, 6), 0)


@pytest.mark.parametrize("scaled", [True, False])
def test_pixels_show_the_cells_of_their_descriptors_in_any_units(scaled) -> None:
    rng = np.random.default_rng(0)
    low, high = np.array([-5.0, 0.0]), np.array([5.0, 900.0])
    archive = CvtArchive(rng.uniform(low, high, (30, 2)), low, high, 1, scaled=scaled)
    for cell in range(30):
        archive.put(elite_of(cell, archive.centroids[cell], float(cell)))
    image = draw_heatmap(archive, 40)
    share = (np.arange(40) + 0.5) / 40
    x, y = (low + share[:, None] * (high - low)).T
    points = np.stack([np.tile(x, 40), np.repeat(y[::-1], 40)], axis=1)
    fitness = archive.fitness[archive.cell_of(points)].reshape(40, 40)
    colors = {value: tuple(image[fitness == value][0]) for value in np.unique(fitness)}
    assert len(set(colors.values())) == len(colors)
    assert all((image[fitness == value] == color).all() for value, color in colors.items())
