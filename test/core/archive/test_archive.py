"""Archives compared with pyribs and with a brute-force reference, and what they refuse."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Solutions, Status
from pga_me_ros.core.archive.geometry import nearest_centroids
from pga_me_ros.core.archive.grid import ON_EDGE, GridArchive
from pga_me_ros.core.operators import Operator
from pga_me_ros.errors import ArchiveError

P = 3
CENTROIDS = np.random.default_rng(5).random((60, 2))

RIBS_STATUS = {0: Status.REJECTED, 1: Status.IMPROVED, 2: Status.NEW}


def cvt() -> CvtArchive:
    return CvtArchive(CENTROIDS, [0, 0], [1, 1], P)


def grid() -> GridArchive:
    return GridArchive((6, 5), [0, 0], [1, 1], P)


def ribs_grid(**arguments: Any) -> Any:
    # Not at the top: this takes seconds in each process that collects tests.
    ribs = pytest.importorskip("ribs.archives")
    return ribs.GridArchive(solution_dim=P, **arguments)


def ribs_for(archive: Archive) -> Any:
    ribs = pytest.importorskip("ribs.archives")
    fields = {"evaluation": ((), np.int64)}
    common = {"ranges": [(0.0, 1.0)] * 2, "extra_fields": fields}
    if archive.bins:
        return ribs_grid(dims=archive.bins, **common)
    return ribs.CVTArchive(solution_dim=P, centroids=archive.centroids, **common)


@pytest.fixture(params=[cvt, grid], ids=["cvt", "grid"])
def archive(request: pytest.FixtureRequest) -> Archive:
    return request.param()


def batch(fitness: list[float], descriptors: list[list[float]], first: int = 0) -> Solutions:
    n = len(fitness)
    ids = np.arange(first, first + n)
    return Solutions.of(
        fitness=fitness,
        descriptors=descriptors,
        parameters=np.outer(ids, np.ones(P)),
        evaluations=ids,
        generation=first,
        operators=np.resize(list(Operator), n),
        parents=np.stack([ids - 1, ids - 2], axis=1),
        steps=ids + 10,
        terminated=ids % 2 == 0,
    )


def stream(batches: int = 40, size: int = 100) -> list[Solutions]:
    """Return solutions like those of episodes: descriptors are shares of steps, and fitness often ties."""
    rng = np.random.default_rng(9)
    out = []
    for i in range(batches):
        length = rng.integers(1, 61, size)[:, None]
        descriptors = rng.integers(0, length + 1, (size, 2)) / length
        descriptors[size // 2 :] = descriptors[: size - size // 2]
        fitness = rng.integers(-20, 20 + i, size).astype(float)
        out.append(batch(fitness.tolist(), descriptors.tolist(), first=i * size))
    return out


@pytest.fixture
def filled(archive: Archive) -> Archive:
    for solutions in stream(3):
        archive.add(solutions)
    return archive


def test_cells_equal_those_of_pyribs(archive: Archive) -> None:
    theirs = ribs_for(archive)
    for solutions in stream():
        ours = archive.cell_of(solutions.descriptors)
        np.testing.assert_array_equal(ours, theirs.index_of(solutions.descriptors))


def test_statuses_equal_those_of_pyribs_one_by_one(archive: Archive) -> None:
    theirs = ribs_for(archive)
    for s in stream(10):
        rows = zip(s.parameters, s.fitness, s.descriptors, s.evaluations, strict=True)
        expected = [
            RIBS_STATUS[int(theirs.add_single(p, f, d, evaluation=e)["status"])]
            for p, f, d, e in rows
        ]
        assert archive.add(s).status.tolist() == expected


def test_elites_equal_those_of_pyribs(archive: Archive) -> None:
    theirs = ribs_for(archive)
    for s in stream():
        archive.add(s)
        for p, f, d, e in zip(s.parameters, s.fitness, s.descriptors, s.evaluations, strict=True):
            theirs.add_single(p, f, d, evaluation=e)
    data = theirs.data()
    expected = dict(zip(data["index"].tolist(), data["evaluation"].tolist(), strict=True))
    assert {elite.cell: elite.evaluation for elite in archive.elites()} == expected


@pytest.mark.parametrize("offset", [0.0, -20.0])
def test_coverage_and_qd_score_equal_those_of_pyribs(archive: Archive, offset: float) -> None:
    theirs = ribs_for(archive)
    for s in stream(5):
        archive.add(s)
        theirs.add(s.parameters, s.fitness, s.descriptors, evaluation=s.evaluations)
    expected = float(theirs.stats.qd_score) - offset * len(theirs)
    assert (archive.coverage, archive.qd_score(offset)) == (len(theirs), pytest.approx(expected))


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.lists(st.tuples(st.integers(-3, 3), st.integers(0, 4), st.integers(0, 4)), max_size=12),
        max_size=4,
    )
)
def test_adding_works_like_a_dictionary(batches: list[list[tuple[int, int, int]]]) -> None:
    archive, reference, evaluation = cvt(), {}, 0
    for solutions in batches:
        archive.add(
            batch(
                [float(f) for f, _, _ in solutions],
                np.array([[x / 4, y / 4] for _, x, y in solutions]).reshape(-1, 2).tolist()
                or np.empty((0, 2)),
                evaluation,
            )
        )
        for fitness, x, y in solutions:
            distances = [math.dist(c, (x / 4, y / 4)) for c in CENTROIDS]
            cell = distances.index(min(distances))
            if cell not in reference or fitness > reference[cell][0]:
                reference[cell] = (fitness, evaluation)
            evaluation += 1
    assert {e.cell: (e.fitness, e.evaluation) for e in archive.elites()} == reference


def test_all_fields_of_an_elite_come_from_its_solution(archive: Archive) -> None:
    archive.add(batch([1.0], [[0.2, 0.3]], first=41))
    elite = archive.best()
    scalars = (elite.fitness, elite.evaluation, elite.generation, elite.operator)
    assert (*scalars, elite.parent1, elite.parent2, elite.steps, elite.terminated) == (
        (1.0, 41, 41, Operator.RANDOM, 40, 39, 51, False)
    )


def test_changed_cells_are_those_whose_elite_changed(filled: Archive) -> None:
    before = {e.cell: e.evaluation for e in filled.elites()}
    added = filled.add(stream(4)[3])
    after = {e.cell: e.evaluation for e in filled.elites()}
    changed = sorted(cell for cell in after if before.get(cell) != after[cell])
    assert added.changed_cells.tolist() == changed


@pytest.mark.parametrize(
    ("value", "column"), [(0.0, 0), (29 / 100, 29), (57 / 100, 57), (1.0, 99), (1.5, 99), (-9, 0)]
)
def test_grid_bins_include_their_lower_edge_and_outside_values(value: float, column: int) -> None:
    archive = GridArchive((100,), [0.0], [1.0], P)
    assert archive.cell_of([[value]]).tolist() == [column]


def test_rounded_descriptors_on_the_edges_of_bins_fill_every_bin() -> None:
    archive = GridArchive((20,), [-1.0], [1.0], P)
    rounded = np.round(np.arange(-10, 11) / 10, 1)
    assert archive.cell_of(rounded[:, None]).tolist() == [*range(20), 19]


@given(
    bins=st.integers(1, 300),
    low=st.integers(-1000, 1000),
    extent=st.integers(1, 2000),
    decimals=st.integers(0, 4),
)
@settings(max_examples=300, deadline=None)
def test_cells_at_the_edges_of_bins_equal_those_of_pyribs(
    bins: int, low: int, extent: int, decimals: int
) -> None:
    """Bounds and edges are as users write them: the float64 numbers nearest to their exact values."""
    scale = 10**decimals
    bounds = low / scale, (low + extent) / scale
    width = (bounds[1] - bounds[0]) / bins
    edges = np.array(
        [float(Fraction(low * bins + extent * j, scale * bins)) for j in range(bins + 1)]
    )
    ours = GridArchive((bins,), [bounds[0]], [bounds[1]], P)
    tolerance = ON_EDGE * (bounds[1] - bounds[0])
    theirs = ribs_grid(dims=(bins,), ranges=[bounds], epsilon=tolerance)
    expected = np.minimum(np.arange(bins + 1), bins - 1)
    assert ours.cell_of(edges[:, None]).tolist() == expected.tolist()
    for shift in (-1e-3 * width, 0.0, 1e-3 * width):
        asked = (edges + shift)[:, None]
        np.testing.assert_array_equal(ours.cell_of(asked), theirs.index_of(asked))
    for asked in (np.nextafter(edges, -math.inf), np.nextafter(edges, math.inf)):
        np.testing.assert_array_equal(ours.cell_of(asked[:, None]), theirs.index_of(asked[:, None]))


@pytest.mark.parametrize("bins", [1, 7, 20, 100, 1000])
@pytest.mark.parametrize("bounds", [(0.0, 1.0), (-1.0, 1.0), (-0.3, 0.6), (0.1, 0.8), (5.0, 47.0)])
def test_cells_at_the_edges_equal_those_of_pyribs_with_its_own_tolerance(
    bins: int, bounds: tuple[float, float]
) -> None:
    low, high = (Fraction(str(bound)) for bound in bounds)
    edges = np.array([float(low + (high - low) * j / bins) for j in range(bins + 1)])
    ours = GridArchive((bins,), [bounds[0]], [bounds[1]], P)
    theirs = ribs_grid(dims=(bins,), ranges=[bounds])
    near = 1e-4 * float(high - low) / bins
    below, above = np.nextafter(edges, -math.inf), np.nextafter(edges, math.inf)
    for asked in (edges, below, above, edges - near, edges + near):
        np.testing.assert_array_equal(ours.cell_of(asked[:, None]), theirs.index_of(asked[:, None]))


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e3, 1e9])
def test_grid_cells_do_not_depend_on_the_unit_of_the_descriptor(unit: float) -> None:
    archive = GridArchive((20,), [-unit], [unit], P)
    descriptors = np.round(np.arange(-10, 11) / 10, 1) * unit
    assert archive.cell_of(descriptors[:, None]).tolist() == [*range(20), 19]


@pytest.mark.parametrize("bins", [6, 32, 1000])
def test_shares_of_steps_fall_into_the_bins_of_exact_arithmetic(bins: int) -> None:
    """Descriptors as in the built-in tasks, whose episodes have up to 1000 steps."""
    rng = np.random.default_rng(4)
    length = rng.integers(1, 1001, 20000)
    count = rng.integers(0, length + 1)
    archive = GridArchive((bins,), [0.0], [1.0], P)
    expected = np.minimum(count * bins // length, bins - 1)
    np.testing.assert_array_equal(archive.cell_of((count / length)[:, None]), expected)


def test_bounds_too_far_apart_are_refused() -> None:
    with pytest.raises(ArchiveError, match="difference must be finite"):
        GridArchive((4,), [-1.7e308], [1.7e308], P)


def test_a_descriptor_far_outside_has_the_nearest_cell() -> None:
    distances = np.linalg.norm(CENTROIDS - [9.0, 9.0], axis=1)
    assert cvt().cell_of([[9.0, 9.0]]).tolist() == [int(distances.argmin())]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fitness", math.nan),
        ("fitness", math.inf),
        ("descriptors", math.nan),
        ("descriptors", -math.inf),
        ("parameters", math.nan),
    ],
)
def test_a_batch_with_a_non_finite_number_is_refused_as_a_whole(
    archive: Archive, name: str, value: float
) -> None:
    solutions = batch([1.0, 2.0], [[0.1, 0.1], [0.9, 0.9]])
    getattr(solutions, name)[-1] = value
    with pytest.raises(ArchiveError, match="finite"):
        archive.add(solutions)
    assert len(archive) == 0


def test_solutions_of_other_controllers_are_refused(archive: Archive) -> None:
    other = Solutions.of(
        fitness=[1], descriptors=[[0, 0]], parameters=np.ones((1, P + 1)), evaluations=[0]
    )
    with pytest.raises(ArchiveError, match=r"4 parameters.*have 3"):
        archive.add(other)


@pytest.mark.parametrize(
    "changes", [{"fitness": [1, 2]}, {"parents": [[1, 2, 3]]}, {"descriptors": [0.1, 0.2]}]
)
def test_arrays_of_different_lengths_are_refused(changes: dict[str, list[int]]) -> None:
    fields = {"fitness": [1], "descriptors": [[0, 0]], "parameters": np.ones((1, P))}
    with pytest.raises(ArchiveError, match="has the shape"):
        Solutions.of(**(fields | changes), evaluations=[0])


@pytest.mark.parametrize("descriptors", [[[0.1]], [[0.1, 0.2, 0.3]], [0.1, 0.2], [[0.1, math.nan]]])
def test_descriptors_that_do_not_fit_are_refused(archive: Archive, descriptors: list) -> None:
    with pytest.raises(ArchiveError, match="Descriptors"):
        archive.cell_of(descriptors)


def test_parents_are_drawn_uniformly(filled: Archive) -> None:
    draws = filled.sample_parents(np.random.default_rng(0), 100 * len(filled))
    counts = np.bincount(draws, minlength=filled.cells)[filled.filled_cells()]
    chi_squared = ((counts - 100) ** 2 / 100).sum()
    assert chi_squared < len(filled) + 4 * math.sqrt(2 * len(filled))


@pytest.mark.parametrize("make", [cvt, grid])
def test_parents_do_not_depend_on_the_order_of_discovery(make: Callable[[], Archive]) -> None:
    descriptors = [[0.1, 0.1], [0.9, 0.9], [0.5, 0.1]]
    draws = []
    for order in (descriptors, descriptors[::-1]):
        archive = make()
        archive.add(batch([1, 2, 3], order))
        draws.append(archive.sample_parents(np.random.default_rng(1), 20).tolist())
    assert draws[0] == draws[1]


@pytest.mark.parametrize("ask", [Archive.best, lambda a: a.sample_parents(np.random, 1)])
def test_an_empty_archive_has_no_elite(archive: Archive, ask) -> None:
    with pytest.raises(ArchiveError, match="empty"):
        ask(archive)


def test_a_cell_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ArchiveError, match="from 0 to 59"):
        cvt().elite(-1)


def test_best_is_the_fittest(filled: Archive) -> None:
    assert filled.best().fitness == max(e.fitness for e in filled.elites()) == filled.max_fitness


def test_nearest_equals_an_exhaustive_search(filled: Archive) -> None:
    wanted = np.array([0.4, 0.6])
    near = [(float(np.linalg.norm(e.descriptor - wanted)), e.cell) for e in filled.elites()]
    expected = [cell for distance, cell in sorted(near) if distance <= 0.3][:4]
    cells, _ = filled.nearest(wanted, k=4, max_distance=0.3)
    assert cells.tolist() == expected


@pytest.mark.parametrize("limits", [{"k": 0}, {"max_distance": math.nan}])
def test_invalid_limits_are_refused(filled: Archive, limits: dict) -> None:
    with pytest.raises(ArchiveError, match="ask for at least one"):
        filled.nearest([0.5, 0.5], **limits)


def test_elites_are_copies(filled: Archive) -> None:
    digest = filled.digest()
    elite = filled.best()
    elite.parameters[:] = 7
    elite.descriptor[:] = 7
    assert filled.digest() == digest


def test_digests_of_equal_archives_are_equal() -> None:
    digests = []
    for _ in range(2):
        archive = cvt()
        for s in stream(2):
            archive.add(s)
        digests.append(archive.digest())
    assert digests[0] == digests[1]


@pytest.mark.parametrize("name", ["fitness", "parameters", "descriptors", "parents", "centroids"])
def test_a_single_bit_changes_the_digest(filled: Archive, name: str) -> None:
    before = filled.digest()
    row = getattr(filled, name)[filled.filled_cells()[0] :][:1]
    row.view(np.uint8).reshape(-1)[0] ^= 1
    assert filled.digest() != before


UNITS = np.array([1.0, 1000.0])
OFFSET = np.array([-3.0, 50.0])


def in_other_units(archive: Archive) -> Archive:
    """Return an empty archive with the same cells and a descriptor in other units."""
    low, high = OFFSET, OFFSET + UNITS
    if archive.bins:
        return GridArchive(archive.bins, low, high, P)
    return CvtArchive(archive.centroids * UNITS + OFFSET, low, high, P)


def test_cells_do_not_depend_on_the_units_of_the_descriptor(archive: Archive) -> None:
    other = in_other_units(archive)
    descriptors = np.random.default_rng(3).uniform(-0.2, 1.2, (2000, 2))
    np.testing.assert_array_equal(
        archive.cell_of(descriptors), other.cell_of(descriptors * UNITS + OFFSET)
    )


def test_the_nearest_do_not_depend_on_the_units_of_the_descriptor(archive: Archive) -> None:
    other = in_other_units(archive)
    for s in stream(3):
        archive.add(s)
        other.add(dataclasses.replace(s, descriptors=s.descriptors * UNITS + OFFSET))
    for wanted in np.random.default_rng(4).random((20, 2)):
        ours = archive.nearest(wanted, 5, max_distance=0.3)
        theirs = other.nearest(wanted * UNITS + OFFSET, 5, max_distance=0.3)
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-9)


def test_in_the_unit_box_cells_equal_those_of_plain_distances_bit_for_bit() -> None:
    descriptors = np.random.default_rng(5).random((5000, 2))
    descriptors[:60] = (CENTROIDS + CENTROIDS[::-1]) / 2  # ties and almost ties
    expected = nearest_centroids(descriptors, CENTROIDS)
    np.testing.assert_array_equal(cvt().cell_of(descriptors), expected)
    assert cvt().note == CvtArchive(CENTROIDS, [0, 0], [1, 1], P, scaled=False).note == ""


def test_an_archive_of_an_older_version_keeps_cells_by_plain_distances_and_says_so() -> None:
    low, high = OFFSET, OFFSET + UNITS
    centroids = CENTROIDS * UNITS + OFFSET
    archive = CvtArchive(centroids, low, high, P, scaled=False)
    descriptors = np.random.default_rng(6).random((500, 2)) * UNITS + OFFSET
    expected = nearest_centroids(descriptors, centroids)
    np.testing.assert_array_equal(archive.cell_of(descriptors), expected)
    assert "older version" in archive.note
    new = CvtArchive(centroids, low, high, P)
    assert new.note == ""
    assert (new.cell_of(descriptors) != expected).any()
