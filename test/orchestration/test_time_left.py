"""The estimated time to the end of a run, on times that were recorded on two cores beside other work."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from pga_me_ros.orchestration.time_left import TimeLeft

LIMIT = 1000
"""Steps after which an episode of the recorded runs is over."""


@dataclass(frozen=True)
class Recorded:
    """Seconds and steps of each generation of a run.

    Attributes:
        batch_size: Evaluations of a generation.
        init: Number of initial generations.
        generations: What was recorded of each.
    """

    batch_size: int
    init: int
    generations: tuple[tuple[float, int], ...]

    def estimates(self, elites: float = 0.0) -> np.ndarray:
        """Return the estimate after each generation."""
        count = len(self.generations)
        left = TimeLeft(self.init, count, self.batch_size * LIMIT)
        found = []
        for done, (seconds, steps) in enumerate(self.generations):
            left.note(done, seconds, steps)
            found.append(left.seconds(done + 1, elites))
        return np.array(found)

    def followed(self) -> np.ndarray:
        """Return the time that followed each generation."""
        seconds = np.array([seconds for seconds, _ in self.generations])
        return seconds.sum() - np.cumsum(seconds)

    def by_rate(self) -> np.ndarray:
        """Return what the rate of the last 20 generations says after each one."""
        seconds = np.array([seconds for seconds, _ in self.generations])
        count = len(seconds)
        return np.array(
            [(count - i) * seconds[max(0, i - 20) : i].mean() for i in range(1, count + 1)]
        )


# fmt: off
HOPPER = Recorded(256, 1, (
    (9.6, 6394), (29.7, 8738), (25.8, 14151), (21.8, 11794), (19.1, 11924), (19.6, 11680), (19.3, 12612), (19.4, 15244),
    (23.8, 89306), (23.1, 81981), (25.6, 107013), (24.1, 112674), (21.9, 70522), (26.6, 108083), (34.4, 120658),
    (29.4, 112050), (22.3, 79232), (24.6, 88364), (24.5, 79402), (23.8, 106100), (29.5, 154051), (29.1, 129742),
    (35.8, 109049), (46.5, 163366), (34.1, 171967), (33.7, 145633), (39.4, 120932), (39.4, 120264), (43.2, 127323),
    (47.9, 94684),
))
"""QDHopper by DCRL-MAP-Elites, 7,680 evaluations; its 3,830 re-evaluations took 346 s."""

WALKER = Recorded(100, 5, (
    (9.4, 5150), (1.3, 4121), (1.5, 4782), (1.9, 5399), (1.3, 4788), (6.8, 1816), (6.5, 1656), (5.6, 1618), (5.8, 1485),
    (5.1, 2080), (4.1, 1766), (5.4, 3364), (5.5, 2112), (6.1, 3043), (6.2, 1538), (6.1, 2249), (5.5, 1569), (5.7, 1801),
    (5.4, 2093), (7.0, 2320), (7.1, 3406), (6.7, 3129), (5.3, 2854), (7.8, 5217), (4.5, 5473), (6.4, 2792), (5.6, 3418),
    (6.8, 4096), (8.4, 7375), (5.9, 5794), (5.8, 4985), (6.0, 5068), (6.2, 8650), (6.4, 9879), (5.2, 4806), (9.5, 5971),
    (11.3, 11208), (9.9, 5618), (8.2, 5433), (11.9, 12912),
))
"""QDWalker by PGA-MAP-Elites, 4,000 evaluations."""
# fmt: on

RUNS = pytest.mark.parametrize("run", [HOPPER, WALKER], ids=["hopper", "walker"])


@RUNS
def test_random_controllers_say_nothing_about_the_time_that_follows(run: Recorded) -> None:
    assert np.isnan(run.estimates()[: run.init]).all()
    assert np.isfinite(run.estimates()[run.init :]).all()


@RUNS
def test_estimates_are_near_what_followed(run: Recorded) -> None:
    places = slice(run.init, -3)
    ratios = run.estimates()[places] / run.followed()[places]
    assert ratios.min() > 0.6
    assert ratios.max() < 1.3


@RUNS
def test_estimates_are_nearer_than_those_of_the_rate(run: Recorded) -> None:
    places = slice(run.init, -1)
    ours, theirs = (
        np.abs(np.log(x[places] / run.followed()[places])).mean()
        for x in (run.estimates(), run.by_rate())
    )
    assert ours < 0.6 * theirs


def test_evaluations_of_elites_count_as_their_steps() -> None:
    estimate = HOPPER.estimates(3830 / HOPPER.batch_size)[-1]
    assert 346 / 2 < estimate < 346 * 2


def test_equal_generations_take_equal_time() -> None:
    run = Recorded(10, 2, ((9.0, 50),) * 2 + ((3.0, 500),) * 10)
    assert run.estimates()[2:] == pytest.approx(run.followed()[2:])


def test_fixed_time_and_steps_are_told_apart() -> None:
    steps = [500, 900, 700, 1100, 1000, 1300]
    left = TimeLeft(0, 7, 1300)
    for number, count in enumerate(steps):
        left.note(number, 4.0 + 0.01 * count, count)
    assert left.seconds(6) == pytest.approx(4.0 + 0.01 * 1300)
    assert left.seconds(7, elites=2.0) == pytest.approx(0.01 * 2.0 * 1300, rel=0.1)


def test_episodes_are_not_expected_beyond_their_time_limit() -> None:
    left = TimeLeft(0, 1010, 2000)
    for number in range(10):
        left.note(number, 0.01 * 200 * (number + 1), 200 * (number + 1))
    assert left.seconds(10) == pytest.approx(1000 * 0.01 * 2000)


@pytest.mark.parametrize(("most", "later"), [(2000, 2000), (10**6, 4000)])
def test_any_budget_has_an_estimate_in_no_time(most: int, later: int) -> None:
    generations = 2**63 // 100
    left = TimeLeft(0, generations, most)
    for number in range(10):
        left.note(number, 0.01 * 200 * (number + 1), 200 * (number + 1))
    assert left.seconds(10) == pytest.approx(generations * 0.01 * later)


def test_what_is_to_come_is_summed_generation_by_generation() -> None:
    left = TimeLeft(0, 25, 10**6)
    for number in range(10):
        left.note(number, 0.01 * 200 * (number + 1), 200 * (number + 1))
    to_come = [2000 + 200 * min(k, 10) for k in range(1, 16)]
    assert left.seconds(10) == pytest.approx(0.01 * sum(to_come))


def test_a_run_of_random_controllers_alone_is_known_at_once() -> None:
    left = TimeLeft(5, 3, 1000)
    assert math.isnan(left.seconds(0))
    left.note(0, 2.0, 100)
    assert left.seconds(1) == pytest.approx(4.0)


def test_nothing_is_left_at_the_end() -> None:
    assert HOPPER.estimates()[-1] == 0.0


def test_a_resumed_run_knows_after_one_generation() -> None:
    left = TimeLeft(5, 100, 1000)
    left.note(60, 7.0, 800)
    assert left.seconds(61) == pytest.approx(39 * 7.0)
