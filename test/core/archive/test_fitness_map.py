"""The archive as a map: the right fitness in the right place."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.fitness_map import FitnessMap
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.errors import ArchiveError

LOW, HIGH = (-1.0, 0.5), (1.0, 2.0)
RNG = np.random.default_rng(0)


def filled(archive: Archive, n: int = 40) -> Archive:
    archive.add(
        Solutions.of(
            fitness=RNG.uniform(-1e3, 1e3, n),
            descriptors=RNG.uniform(archive.low, archive.high, (n, archive.dimensions)),
            parameters=np.zeros((n, 1)),
            evaluations=range(n),
        )
    )
    return archive


def cvt() -> CvtArchive:
    return filled(CvtArchive(RNG.uniform(LOW, HIGH, (50, 2)), LOW, HIGH, 1))


def grid(*bins: int) -> GridArchive:
    return filled(GridArchive(bins, LOW, HIGH, 1))


def expected(archive: Archive, descriptors: np.ndarray) -> list[int]:
    """Return the scaled fitness of the elites in the cells of descriptors, -1 for empty cells."""
    fitness = archive.fitness[archive.cell_of(descriptors)]
    known = archive.fitness[archive.filled]
    share = (fitness - known.min()) / (known.max() - known.min())
    return [-1 if np.isnan(x) else round(100 * x) for x in share.tolist()]


def squares(shown: FitnessMap, descriptors: np.ndarray) -> np.ndarray:
    """Return (n, 2) column and row of descriptors, as a reader of the map computes them."""
    return ((descriptors - shown.origin) / shown.resolution).astype(int)


def at(shown: FitnessMap, archive: Archive, descriptors: np.ndarray) -> list[int]:
    columns, rows = squares(shown, descriptors).T
    return shown.values(archive)[rows, columns].tolist()


def test_a_grid_of_square_bins_is_the_map() -> None:
    archive = grid(8, 6)
    shown = FitnessMap(archive)
    assert (shown.columns, shown.rows, shown.resolution) == (8, 6, 0.25)
    descriptors = RNG.uniform(LOW, HIGH, (1000, 2))
    values = at(shown, archive, descriptors)
    assert values == expected(archive, descriptors)
    assert {-1, 0, 100} <= set(values)


@pytest.mark.parametrize("make", [cvt, lambda: grid(7, 5)])
def test_a_square_shows_the_cell_at_its_center(make) -> None:
    archive = make()
    shown = FitnessMap(archive, 100)
    assert (shown.columns, shown.rows) == (100, 75)
    descriptors = RNG.uniform(LOW, HIGH, (1000, 2))
    centers = shown.origin + (squares(shown, descriptors) + 0.5) * shown.resolution
    values = at(shown, archive, descriptors)
    assert values == expected(archive, centers)
    assert {-1, 0, 100} <= set(values)


def test_squares_outside_the_descriptor_space_are_unknown() -> None:
    archive = filled(CvtArchive([[0.5, 0.5]], [0, 0], [1.0, 0.42], 1), 1)
    assert FitnessMap(archive, 5).values(archive).tolist() == [[100] * 5] * 2 + [[-1] * 5]


def test_an_archive_without_elites_is_empty_and_equal_elites_are_all_best() -> None:
    archive = GridArchive([2, 2], [0, 0], [1, 1], 1)
    shown = FitnessMap(archive)
    assert shown.values(archive).tolist() == [[-1, -1], [-1, -1]]
    archive.add(
        Solutions.of(
            fitness=[3.0, 3.0],
            descriptors=[[0.9, 0.1], [0.1, 0.9]],
            parameters=np.zeros((2, 1)),
            evaluations=range(2),
        )
    )
    assert shown.values(archive).tolist() == [[-1, 100], [100, -1]]


def test_extreme_fitness_is_scaled() -> None:
    archive = GridArchive([3, 1], [0, 0], [3, 1], 1)
    archive.add(
        Solutions.of(
            fitness=[-1.7e308, 0.0, 1.7e308],
            descriptors=[[0.5, 0.5], [1.5, 0.5], [2.5, 0.5]],
            parameters=np.zeros((3, 1)),
            evaluations=range(3),
        )
    )
    assert FitnessMap(archive).values(archive).tolist() == [[0, 50, 100]]


def test_other_dimensions_have_no_map() -> None:
    with pytest.raises(ArchiveError, match="two dimensions; this archive has 1"):
        FitnessMap(GridArchive([3], [0], [1], 1))


@pytest.mark.parametrize("scaled", [True, False])
def test_squares_show_the_cells_of_their_centers_in_any_units(scaled: bool) -> None:
    rng = np.random.default_rng(0)
    low, high = np.array([-5.0, 0.0]), np.array([5.0, 90.0])
    archive = CvtArchive(rng.uniform(low, high, (30, 2)), low, high, 1, scaled=scaled)
    archive.filled[:] = True
    archive.fitness[:] = np.arange(30)
    shown = FitnessMap(archive, 90)
    assert (shown.columns, shown.rows) == (10, 90)
    centers = np.stack(
        [np.tile(np.arange(10) - 4.5, 90), np.repeat(np.arange(90) + 0.5, 10)], axis=1
    )
    expected = np.rint(100 * archive.cell_of(centers) / 29).reshape(90, 10)
    np.testing.assert_array_equal(shown.values(archive), expected)


def test_an_outlier_leaves_the_others_their_values() -> None:
    archive = GridArchive((10, 10), (0.0, 0.0), (1.0, 1.0), 1)
    centers = (np.arange(10) + 0.5) / 10
    archive.add(
        Solutions.of(
            fitness=[*np.arange(99.0), -1e6],
            descriptors=np.stack(np.meshgrid(centers, centers), axis=-1).reshape(-1, 2),
            parameters=np.zeros((100, 1)),
            evaluations=range(100),
        )
    )
    values = np.sort(FitnessMap(archive).values(archive), axis=None)
    assert (values.min(), values.max()) == (0, 100)
    assert len(set(values.tolist())) > 40
