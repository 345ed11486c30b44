"""Choosing elites by what is known of them, and what is said when none is good enough."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.choosing import Choices, Demands, Judging, NotFoundError
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.errors import RequestError

LUCKY, STEADY, UNKNOWN = 0, 2, 3
"""Cells: found with 100 but worth 20, found with 50 and worth 50, found with 40 and not re-evaluated."""


@pytest.fixture
def archive() -> Archive:
    archive = GridArchive((4,), (0.0,), (2.0,), 1)
    archive.add(
        Solutions.of(
            fitness=[100.0, 50.0, 40.0],
            descriptors=[[0.2], [1.2], [1.8]],
            parameters=np.zeros((3, 1)),
            evaluations=[10, 11, 12],
        )
    )
    return archive


@pytest.fixture
def known() -> Statistics:
    known = Statistics.none(4, 1)
    known.repeats[[LUCKY, STEADY]] = 10, 5
    known.mean_fitness[[LUCKY, STEADY]] = 20.0, 50.0
    known.mean_descriptor[[LUCKY, STEADY], 0] = 0.6, 1.2
    known.fall_share[[LUCKY, STEADY]] = 0.9, 0.2
    return known


def choices(
    archive: Archive, known: Statistics, judging: Judging = Judging.BEST_KNOWN, **limits: float
) -> Choices:
    return Choices(archive, known, ["share"], Demands(judging, **limits))


def test_the_mean_counts_where_there_is_one(archive: Archive, known: Statistics) -> None:
    found = choices(archive, known)
    assert found.fittest() == STEADY
    assert found.fittest_first().tolist() == [STEADY, UNKNOWN, LUCKY]
    assert [found.by_mean(cell) for cell in (LUCKY, STEADY, UNKNOWN)] == [True, True, False]
    cells, distances = found.nearest([0.6], 3)
    assert cells.tolist() == [LUCKY, STEADY, UNKNOWN]
    assert distances.tolist() == pytest.approx([0.0, 0.3, 0.6])


def test_the_single_evaluation_counts_if_asked_for(archive: Archive, known: Statistics) -> None:
    found = choices(archive, known, Judging.SINGLE)
    assert found.fittest() == LUCKY
    assert not any(found.by_mean(cell) for cell in (LUCKY, STEADY, UNKNOWN))
    assert found.nearest([0.2])[1].tolist() == [0.0]


def test_those_without_means_are_left_out_if_asked_for(archive: Archive, known: Statistics) -> None:
    found = choices(archive, known, Judging.MEAN)
    assert found.fittest_first().tolist() == [STEADY, LUCKY]
    with pytest.raises(NotFoundError, match="of cell 3 was not re-evaluated"):
        found.of_cell(UNKNOWN)


def test_only_what_is_known_to_fall_seldom_meets_a_share(
    archive: Archive, known: Statistics
) -> None:
    assert choices(archive, known, max_fall_share=0.2).cells().tolist() == [STEADY]
    assert choices(archive, known, max_fall_share=1.0).cells().tolist() == [LUCKY, STEADY]
    assert choices(archive, known, max_fall_share=0.2).nearest([0.2])[0].tolist() == [STEADY]
    seldom = choices(archive, known, max_fall_share=0.1)
    with pytest.raises(NotFoundError) as none:
        seldom.fittest()
    assert str(none.value) == (
        "No behavior is known to fall in at most 10 % of its evaluations; that of cell 2 falls in 20 % of 5 "
        "re-evaluations."
    )
    with pytest.raises(
        NotFoundError, match=r"cell 2 falls in 20 % of 5 re-evaluations; at most 10"
    ):
        seldom.of_cell(STEADY)
    with pytest.raises(NotFoundError, match=r"of cell 3 was not re-evaluated; at most 10 %"):
        seldom.of_cell(UNKNOWN)


def test_what_is_too_far_is_not_given_but_named(archive: Archive, known: Statistics) -> None:
    with pytest.raises(NotFoundError) as none:
        choices(archive, known).nearest([0.88], max_distance=0.1)
    assert str(none.value) == (
        "No behavior lies within 0.1 of [0.88]. The nearest is that of cell 0, 0.140 away: descriptor [0.600], fitness "
        "20.0; it falls in 90 % of 10 re-evaluations."
    )
    with pytest.raises(NotFoundError) as none:
        choices(archive, known, min_fitness=30.0, max_fall_share=0.5).nearest([0.6], 2, 0.1)
    assert str(none.value) == (
        "No behavior with a fitness of 30.0 or more and falls in at most 50 % of its evaluations lies within 0.1 of "
        "[0.6]. The nearest is that of cell 2, 0.300 away: descriptor [1.200], fitness 50.0; it falls in 20 % of 5 "
        "re-evaluations."
    )


def test_when_none_meets_a_limit_the_nearest_of_all_is_named(
    archive: Archive, known: Statistics
) -> None:
    with pytest.raises(NotFoundError) as none:
        choices(archive, known, min_fitness=60.0).nearest([1.8])
    assert str(none.value) == (
        "No behavior has a fitness of 60.0 or more; the best has 50.0. The nearest is that of cell 3, 0.000 away: "
        "descriptor [1.800], fitness 40.0; it was not re-evaluated."
    )


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"min_fitness": math.nan}, "min_fitness is NaN"),
        ({"max_fall_share": math.nan}, "max_fall_share is nan; give a share"),
        ({"max_fall_share": -0.1}, "max_fall_share is -0.1; give a share"),
    ],
)
def test_limits_that_make_no_sense_are_refused(limits: dict[str, float], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        Demands(**limits)
