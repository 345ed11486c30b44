"""Pictures of archives: the right colour in the right place, in a file that others can read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from pga_me_ros.core.archive import Archive, CvtArchive, GridArchive, Solutions
from pga_me_ros.core.cvt import grid_centroids
from pga_me_ros.core.errors import ArchiveError
from pga_me_ros.core.heatmap import ANCHORS, EMPTY, render, write_png

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


def cvt(dimensions: int, bins: int) -> CvtArchive:
    low, high = [0.0] * dimensions, [1.0] * dimensions
    return CvtArchive(grid_centroids([bins] * dimensions, low, high), low, high, 1)


def grid(dimensions: int, bins: int) -> GridArchive:
    return GridArchive([bins] * dimensions, [0.0] * dimensions, [1.0] * dimensions, 1)


@pytest.mark.parametrize("make", [cvt, grid])
def test_the_first_descriptor_grows_right_and_the_second_up(make) -> None:
    image = render(filled(make(2, 10), [[0.05, 0.05], [0.95, 0.05]], [0.0, 1.0]), 100)
    corners = [tuple(image[y, x]) for y, x in ((99, 0), (99, 99), (0, 0), (0, 99))]
    assert corners == [DARK, BRIGHT, EMPTY, EMPTY]


@pytest.mark.parametrize("make", [cvt, grid])
def test_each_cell_has_its_share_of_pixels(make) -> None:
    image = render(filled(make(2, 10), [[0.55, 0.35]], [1.0]), 100)
    lit = (image != EMPTY).any(axis=2)
    assert lit[60:70, 50:60].all()
    assert lit.sum() == 100


def test_every_pixel_of_a_tessellation_shows_the_nearest_cell() -> None:
    rng = np.random.default_rng(0)
    centroids = rng.random((20, 2))
    archive = CvtArchive(centroids, [0, 0], [1, 1], 1)
    filled(archive, centroids.tolist(), list(range(20)))
    image = render(archive, 40)
    shown = [tuple(image[39 - int(y * 40), int(x * 40)]) for x, y in centroids]
    brightness = np.array(shown).sum(axis=1)
    assert (np.diff(brightness) > 0).all()


@pytest.mark.parametrize("make", [cvt, grid])
def test_one_dimension_is_shown_as_columns(make) -> None:
    image = render(filled(make(1, 10), [[0.35], [0.95]], [0.0, 1.0]), 100)
    assert [tuple(image[0, x]) for x in (0, 35, 95)] == [EMPTY, DARK, BRIGHT]


def test_a_cell_narrower_than_a_pixel_is_still_seen() -> None:
    image = render(filled(cvt(1, 1000), [[0.5005]], [1.0]), 100)
    assert tuple(image[0, 50]) == BRIGHT


@pytest.mark.parametrize("make", [cvt, grid])
def test_four_dimensions_are_maps_within_a_map(make) -> None:
    # Outer column 5 of 6, outer row 1; inner column 2, inner row 4; rows count from the bottom.
    descriptor = (np.array([5, 1, 2, 4]) + 0.5) / 6
    image = render(filled(make(4, 6), [descriptor.tolist()], [1.0]), 360)
    lit = np.argwhere((image == BRIGHT).all(axis=2))
    column, row = 5 * 6 + 2, 1 * 6 + 4
    bottom, left = 360 - 10 * row, 10 * column
    assert (lit.min(axis=0), lit.max(axis=0)) == (
        pytest.approx([bottom - 10, left]),
        pytest.approx([bottom - 1, left + 9]),
    )


def test_a_given_scale_is_kept() -> None:
    image = render(filled(grid(1, 10), [[0.05]], [5.0]), 100, low=5.0, high=10.0)
    assert tuple(image[0, 0]) == DARK


def test_an_empty_archive_is_all_grey() -> None:
    assert (render(cvt(2, 4), 20) == EMPTY).all()


def test_brightness_grows_with_fitness() -> None:
    descriptors = [[(i + 0.5) / 100] for i in range(100)]
    image = render(filled(grid(1, 100), descriptors, list(range(100))), 100)
    luminance = image[0] @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luminance) > 0).all()


def test_too_few_pixels_are_refused() -> None:
    with pytest.raises(ArchiveError, match="36 bins need as many"):
        render(grid(4, 6), 35)


def test_a_png_is_read_back_by_others(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (7, 13, 3)).astype(np.uint8)
    write_png(tmp_path / "picture.png", image)
    read = np.round(imread(tmp_path / "picture.png") * 255).astype(np.uint8)
    np.testing.assert_array_equal(read, image)
