"""Cells that hold several solutions, judged by all their evaluations, against what was worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.depth import CellDepth, DepthChange
from pga_me_ros.core.archive.elites import Solutions, Status
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.operators import Operator
from pga_me_ros.errors import ArchiveError, RequestError

NEW, IMPROVED, REJECTED = Status.NEW, Status.IMPROVED, Status.REJECTED


@pytest.fixture
def archive() -> Archive:
    """Four cells side by side."""
    return GridArchive((4,), (0.0,), (4.0,), 1)


def batch(
    fitness: Sequence[float],
    places: Sequence[float],
    first: int,
    again: Sequence[int] = (),
) -> Solutions:
    """Return evaluations from `first` on; the last of them are those of the solutions `again`."""
    n = len(fitness)
    new = n - len(again)
    ids = np.arange(first, first + n)
    return Solutions.of(
        fitness=fitness,
        descriptors=np.array(places, np.float64)[:, None],
        parameters=ids[:, None].astype(np.float32),
        evaluations=ids,
        operators=[Operator.GA] * new + [Operator.EXTRACTED] * len(again),
        parents=[[-1, -1]] * new + [[k, -1] for k in again],
    )


def add(deep: CellDepth, solutions: Solutions) -> DepthChange:
    return deep.add(solutions, np.ones(len(solutions), np.bool_))


def contents(deep: CellDepth) -> dict[int, list[tuple[int, float]]]:
    """Return evaluation ids and fitness of the solutions of each cell, the elite first."""
    archive = deep.archive
    return {
        cell: [
            (int(archive.evaluations[cell]), float(archive.fitness[cell])),
            *((s.evaluation, s.fitness) for s in deep.below.get(cell, ())),
        ]
        for cell in archive.filled_cells().tolist()
    }


def test_a_cell_keeps_its_best_the_fittest_first(archive: Archive) -> None:
    deep = CellDepth(archive, 2)
    change = add(deep, batch([1.0, 3.0, 2.0, 2.0], [0.5, 0.5, 0.5, 2.5], 0))
    assert contents(deep) == {0: [(1, 3.0), (2, 2.0)], 2: [(3, 2.0)]}
    assert change.added.status.tolist() == [NEW, IMPROVED, REJECTED, NEW]
    assert change.changed_cells.tolist() == [0, 2]
    assert [s.evaluation for s in change.below] == [2]
    assert sorted(change.samples) == sorted(deep.samples) == [1, 2, 3]
    change = add(deep, batch([2.5, 0.5], [0.5, 0.5], 4))
    assert contents(deep)[0] == [(1, 3.0), (4, 2.5)]
    assert change.added.status.tolist() == [REJECTED, REJECTED]
    assert (change.changed_cells.tolist(), change.left, change.forgotten) == ([], (2,), (2,))


def test_of_equals_the_first_one_stays(archive: Archive) -> None:
    deep = CellDepth(archive, 2)
    add(deep, batch([1.0], [0.5], 0))
    change = add(deep, batch([1.0], [0.5], 1))
    assert contents(deep)[0] == [(0, 1.0), (1, 1.0)]
    assert change.added.status.tolist() == [REJECTED]


def test_a_lucky_elite_is_unmasked_and_the_next_best_returns(archive: Archive) -> None:
    deep = CellDepth(archive, 3)
    add(deep, batch([9.0, 5.0], [0.5, 0.5], 0))
    change = add(deep, batch([-1.0], [0.75], 2, again=[0]))
    # The mean of 9 and -1 at 0.5 and 0.75.
    assert contents(deep)[0] == [(1, 5.0), (0, 4.0)]
    assert deep.below[0][0].descriptor.tolist() == [0.625]
    assert deep.samples[0].count == 2
    assert change.added.status.tolist() == [REJECTED], "it was found before"
    assert change.changed_cells.tolist() == [0]
    assert [s.evaluation for s in change.below] == [0]
    assert change.left == (1,), "it is the elite now"


def test_who_comes_up_is_below_no_more(archive: Archive) -> None:
    deep = CellDepth(archive, 2)
    add(deep, batch([9.0, 5.0], [0.5, 0.5], 0))
    # Its mean belongs to cell 2.
    change = add(deep, batch([9.0], [3.6], 2, again=[0]))
    assert contents(deep) == {0: [(1, 5.0)], 2: [(0, 9.0)]}
    assert (change.changed_cells.tolist(), change.left, change.forgotten) == ([0, 2], (1,), ())
    assert archive.descriptors[2].tolist() == [2.05]
    assert archive.parameters[2].tolist() == [0.0], "another controller came with it"


def test_a_cell_whose_only_solution_moves_is_empty(archive: Archive) -> None:
    deep = CellDepth(archive, 1)
    add(deep, batch([1.0, 7.0], [0.5, 2.5], 0))
    change = add(deep, batch([1.0], [4.0], 2, again=[0]))
    # It falls into cell 2, where a fitter one is: nobody holds it any more.
    assert contents(deep) == {2: [(1, 7.0)]}
    assert change.emptied_cells.tolist() == [0]
    assert change.forgotten == (0,)
    assert (archive.coverage, math.isnan(archive.fitness[0])) == (1, True)
    assert archive.evaluations[0] == -1


def test_what_was_taken_out_is_offered_before_what_is_new(archive: Archive) -> None:
    deep = CellDepth(archive, 1)
    add(deep, batch([4.0], [0.5], 0))
    change = add(deep, batch([4.0, 4.0], [0.5, 0.5], 1, again=[0]))
    assert contents(deep)[0] == [(0, 4.0)]
    assert change.added.status.tolist() == [REJECTED, REJECTED]


def test_the_same_may_be_evaluated_twice_in_a_generation(archive: Archive) -> None:
    deep = CellDepth(archive, 1)
    add(deep, batch([6.0], [0.5], 0))
    add(deep, batch([3.0, 0.0], [0.5, 0.5], 1, again=[0, 0]))
    assert contents(deep)[0] == [(0, 3.0)]
    assert deep.samples[0].count == 3


def test_solutions_that_are_not_offered_stay_out(archive: Archive) -> None:
    deep = CellDepth(archive, 2)
    change = deep.add(batch([1.0, 2.0], [0.5, 0.5], 0), np.array([True, False]))
    assert contents(deep) == {0: [(0, 1.0)]}
    assert change.added.status.tolist() == [NEW, REJECTED]


def test_a_draw_depends_on_the_archive_the_seed_and_the_generation_alone(archive: Archive) -> None:
    deep = CellDepth(archive, 4)
    add(deep, batch([4.0, 3.0, 2.0, 1.0, 5.0], [0.5, 0.5, 0.5, 0.5, 2.5], 0))
    drawn = deep.draw(1, 7, 3)
    assert drawn.tolist() == deep.draw(1, 7, 3).tolist()
    assert len(set(drawn.tolist())) == 3
    draws = {tuple(deep.draw(1, t, 3).tolist()) for t in range(50)}
    assert len(draws) > 5
    assert deep.parameters(drawn)[:, 0].tolist() == [float(k) for k in drawn]


def test_elites_are_drawn_likelier_than_those_below_by_a_factor_of_e(archive: Archive) -> None:
    deep = CellDepth(archive, 3)
    add(deep, batch([3.0, 2.0, 1.0], [0.5, 0.5, 0.5], 0))
    draws = np.array([deep.draw(2, t, 1)[0] for t in range(6000)])
    counts = np.bincount(draws, minlength=3)
    assert counts[0] / counts[1] == pytest.approx(math.e, rel=0.1)
    assert counts[1] / counts[2] == pytest.approx(math.e, rel=0.15)


def test_where_there_are_fewer_than_are_drawn_all_are_again_and_again(archive: Archive) -> None:
    deep = CellDepth(archive, 2)
    add(deep, batch([3.0, 2.0], [0.5, 2.5], 0))
    drawn = deep.draw(3, 1, 5)
    assert sorted(set(drawn.tolist())) == [0, 1]
    assert len(drawn) == 5
    with pytest.raises(RequestError, match="The archive is empty"):
        CellDepth(GridArchive((4,), (0.0,), (4.0,), 1), 2).draw(3, 1, 1)


def test_what_is_wrong_with_a_batch_changes_nothing(archive: Archive) -> None:
    deep = CellDepth(archive, 2)
    add(deep, batch([3.0, 2.0], [0.5, 0.5], 0))
    before, samples = contents(deep), dict(deep.samples)
    with pytest.raises(RequestError, match="that of solution 9 once more, which the archive does"):
        add(deep, batch([1.0], [0.5], 2, again=[9]))
    with pytest.raises(ArchiveError, match="fitness of evaluation 3 must be finite"):
        add(deep, batch([1.0, math.nan], [0.5, 0.5], 2))
    assert (contents(deep), deep.samples) == (before, samples)
