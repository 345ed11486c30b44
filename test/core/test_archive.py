"""Archives against pyribs' and against a brute-force reference, and what they refuse."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ribs.archives import CVTArchive as RibsCvt
from ribs.archives import GridArchive as RibsGrid

from pga_me_ros.core.archive import Archive, CvtArchive, GridArchive, Operator, Solutions, Status
from pga_me_ros.core.errors import ArchiveError

P = 3
CENTROIDS = np.random.default_rng(5).random((60, 2))

RIBS_STATUS = {0: Status.REJECTED, 1: Status.IMPROVED, 2: Status.NEW}


def cvt() -> CvtArchive:
    return CvtArchive(CENTROIDS, [0, 0], [1, 1], P)


def grid() -> GridArchive:
    return GridArchive((6, 5), [0, 0], [1, 1], P)


def ribs_for(archive: Archive) -> RibsCvt | RibsGrid:
    fields = {"evaluation": ((), np.int64)}
    common = {"solution_dim": P, "ranges": [(0.0, 1.0)] * 2, "extra_fields": fields}
    if archive.bins:
        return RibsGrid(dims=archive.bins, **common)
    return RibsCvt(centroids=archive.centroids, **common)


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
    """Solutions as episodes give them: descriptors are shares of steps, fitness often ties."""
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


def test_cells_are_those_of_pyribs(archive: Archive) -> None:
    theirs = ribs_for(archive)
    for solutions in stream():
        ours = archive.cell_of(solutions.descriptors)
        np.testing.assert_array_equal(ours, theirs.index_of(solutions.descriptors))


def test_statuses_are_those_of_pyribs_one_by_one(archive: Archive) -> None:
    theirs = ribs_for(archive)
    for s in stream(10):
        rows = zip(s.parameters, s.fitness, s.descriptors, s.evaluations, strict=True)
        expected = [
            RIBS_STATUS[int(theirs.add_single(p, f, d, evaluation=e)["status"])]
            for p, f, d, e in rows
        ]
        assert archive.add(s).status.tolist() == expected


def test_elites_are_those_of_pyribs(archive: Archive) -> None:
    theirs = ribs_for(archive)
    for s in stream():
        archive.add(s)
        for p, f, d, e in zip(s.parameters, s.fitness, s.descriptors, s.evaluations, strict=True):
            theirs.add_single(p, f, d, evaluation=e)
    data = theirs.data()
    expected = dict(zip(data["index"].tolist(), data["evaluation"].tolist(), strict=True))
    assert {elite.cell: elite.evaluation for elite in archive.elites()} == expected


@pytest.mark.parametrize("offset", [0.0, -20.0])
def test_coverage_and_qd_score_are_those_of_pyribs(archive: Archive, offset: float) -> None:
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
def test_adding_is_that_of_a_dictionary(batches: list[list[tuple[int, int, int]]]) -> None:
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


def test_all_fields_of_an_elite_are_its_solutions(archive: Archive) -> None:
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
def test_grid_bins_hold_their_lower_edge_and_what_lies_outside(value: float, column: int) -> None:
    archive = GridArchive((100,), [0.0], [1.0], P)
    assert archive.cell_of([[value]]).tolist() == [column]


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
def test_a_batch_with_a_number_that_is_none_is_refused_whole(
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
def test_arrays_of_different_batches_are_refused(changes: dict[str, list[int]]) -> None:
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
def test_an_empty_archive_has_no_elite_to_give(archive: Archive, ask) -> None:
    with pytest.raises(ArchiveError, match="empty"):
        ask(archive)


def test_a_cell_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ArchiveError, match="from 0 to 59"):
        cvt().elite(-1)


def test_best_is_the_fittest(filled: Archive) -> None:
    assert filled.best().fitness == max(e.fitness for e in filled.elites()) == filled.max_fitness


def test_nearest_is_that_of_a_search_through_all(filled: Archive) -> None:
    wanted = np.array([0.4, 0.6])
    near = [
        (float(np.linalg.norm(e.descriptor - wanted)), e.cell)
        for e in filled.elites()
        if e.fitness >= 5
    ]
    expected = [cell for distance, cell in sorted(near) if distance <= 0.3][:4]
    cells, _ = filled.nearest(wanted, k=4, max_distance=0.3, min_fitness=5)
    assert cells.tolist() == expected


@pytest.mark.parametrize(
    "limits", [{"k": 0}, {"max_distance": math.nan}, {"min_fitness": math.nan}]
)
def test_limits_that_mean_nothing_are_refused(filled: Archive, limits: dict) -> None:
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
