"""The corrected archive and its measures, against values computed by hand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import (
    NOBODY,
    complete_metrics,
    corrected_archive,
    corrected_metrics,
    corrected_owners,
    in_words,
)
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.storage.reevaluations import Reevaluations, RepeatOutcome

RANGE = 2.0
"""The descriptor goes from 0 to 2, so that a share of its range is half of a difference."""


@pytest.fixture
def archive() -> Archive:
    """Four cells of which three are filled: cells 0, 1 and 3 by evaluations 10, 11 and 12."""
    archive = GridArchive((4,), (0.0,), (RANGE,), 1)
    archive.add(
        Solutions.of(
            fitness=[100.0, 50.0, 10.0],
            descriptors=[[0.25], [0.75], [1.75]],
            parameters=np.zeros((3, 1)),
            evaluations=[10, 11, 12],
        )
    )
    return archive


def outcomes(evaluation: int, *values: tuple[float, float, bool]) -> list[RepeatOutcome]:
    """Return re-evaluations of an elite: fitness, descriptor, and whether it fell."""
    return [
        RepeatOutcome(evaluation, repeat, fitness, np.array([descriptor]), 5, fell)
        for repeat, (fitness, descriptor, fell) in enumerate(values)
    ]


TENTH = outcomes(10, (20.0, 0.6, True), (40.0, 0.8, True))
"""It was lucky, and it belongs to cell 1."""
ELEVENTH = outcomes(11, (44.0, 0.5, False), (48.0, 0.9, True))
TWELFTH = outcomes(12, (10.0, 1.75, False), (14.0, 1.75, False), (12.0, 1.75, False))


def statistics(archive: Archive, *lists: list[RepeatOutcome]) -> Statistics:
    rows = Reevaluations.none("run", 1).with_more([row for rows in lists for row in rows])
    return rows.statistics(archive)


def test_statistics_tell_the_share_of_falls(archive: Archive) -> None:
    known = statistics(archive, TENTH, ELEVENTH)
    assert known.fall_share[[0, 1]].tolist() == [1.0, 0.5]
    assert np.isnan(known.fall_share[[2, 3]]).all()
    assert known.repeats.tolist() == [2, 2, 0, 0]


def test_the_corrected_archive_holds_the_best_mean_of_each_cell(archive: Archive) -> None:
    known = statistics(archive, TENTH, ELEVENTH, TWELFTH)
    # Means: 10: fitness 30 at 0.7, 11: 46 at 0.7, 12: 12 at 1.75.
    assert corrected_owners(archive, known).tolist() == [NOBODY, 1, NOBODY, 3]
    corrected = corrected_archive(archive, known)
    assert corrected.filled.tolist() == [False, True, False, True]
    assert corrected.evaluations.tolist() == [NOBODY, 11, NOBODY, 12]
    assert corrected.fitness[[1, 3]].tolist() == [46.0, 12.0]
    assert corrected.descriptors[[1, 3], 0].tolist() == pytest.approx([0.7, 1.75])
    assert archive.filled.tolist() == [True, True, False, True], "the archive itself was changed"


def test_of_equals_the_first_one_stays_as_in_any_archive(archive: Archive) -> None:
    equal = outcomes(11, (30.0, 0.7, False))
    known = statistics(archive, TENTH, equal)
    assert corrected_owners(archive, known).tolist() == [NOBODY, 0, NOBODY, NOBODY]


def test_a_mean_beyond_the_bounds_belongs_to_the_cell_at_the_edge(archive: Archive) -> None:
    known = statistics(archive, outcomes(12, (1.0, 9.0, False)))
    assert corrected_owners(archive, known).tolist() == [NOBODY, NOBODY, NOBODY, 3]


def test_measures_are_those_computed_by_hand(archive: Archive) -> None:
    measured = corrected_metrics(archive, statistics(archive, TENTH, ELEVENTH, TWELFTH))
    assert measured is not None
    assert (measured.elites, measured.repeats, measured.reevaluations) == (3, 2, 7)
    assert (measured.coverage, measured.qd_score, measured.max_fitness) == (2, 58.0, 46.0)
    assert measured.mean_fitness == pytest.approx((30 + 46 + 12) / 3)
    # Found with 100, 50 and 10.
    assert measured.fitness_difference == pytest.approx((70 + 4 - 2) / 3)
    # Found at 0.25, 0.75 and 1.75; in shares of the range of 2.
    assert measured.descriptor_error == pytest.approx((0.45 + 0.05 + 0.0) / RANGE / 3)
    # Sample standard deviations of two values are their difference by the root of 2.
    root = math.sqrt(2.0)
    assert measured.fitness_spread == pytest.approx((20 / root + 4 / root + 2) / 3)
    assert measured.descriptor_spread == pytest.approx((0.2 / root + 0.4 / root + 0.0) / RANGE / 3)
    assert measured.fall_share == pytest.approx((1.0 + 0.5 + 0.0) / 3)


def test_only_when_all_elites_were_reevaluated_is_the_archive_measured(
    archive: Archive,
) -> None:
    some, all_of_them = (TENTH, ELEVENTH), (TENTH, ELEVENTH, TWELFTH)
    assert complete_metrics(archive, statistics(archive, *some)) is None
    assert complete_metrics(archive, statistics(archive)) is None
    assert corrected_metrics(archive, statistics(archive)) is None
    complete = complete_metrics(archive, statistics(archive, *all_of_them))
    assert complete == corrected_metrics(archive, statistics(archive, *all_of_them))
    assert complete is not None
    words = in_words(complete, archive)
    assert words[-1].startswith("corrected archive: coverage 2 (not 3), QD-score 58.0 (not 160.0)")
    part = corrected_metrics(archive, statistics(archive, *some))
    assert part is not None
    assert not any(line.startswith("corrected archive") for line in in_words(part, archive))


def test_a_single_re_evaluation_has_no_spread(archive: Archive) -> None:
    measured = corrected_metrics(archive, statistics(archive, outcomes(12, (1.0, 1.0, True))))
    assert measured is not None
    assert math.isnan(measured.fitness_spread)
    assert math.isnan(measured.descriptor_spread)
    assert measured.fall_share == 1.0


def test_measures_do_not_depend_on_the_order_of_the_rows(archive: Archive) -> None:
    rows = [*TENTH, *ELEVENTH, *TWELFTH]
    one = Reevaluations.none("run", 1).with_more(rows)
    other = Reevaluations.none("run", 1).with_more(rows[4:]).with_more(rows[3::-1])
    assert one.evaluation.tolist() != other.evaluation.tolist()
    measures = [corrected_metrics(archive, r.statistics(archive)) for r in (one, other)]
    assert measures[0] is not None
    assert measures[1] is not None
    assert dataclasses.astuple(measures[0]) == dataclasses.astuple(measures[1])
