"""How much work evaluators get at once; when requests count as late, and when as lost."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

from pga_me_ros.orchestration.evaluator_work import WORTHWHILE, Chunk, Job, Worker, share


def worker(**state: Any) -> Worker:
    """Return an evaluator that got two evaluations at time 0, and one more at time 5."""
    chunks = [Chunk([1, 2], sent=0.0), Chunk([3], sent=5.0)]
    return Worker(None, ("host", 1), 0.0, 0.0, 0, **{"progress": 0.0, "chunks": chunks, **state})


def lost(w: Worker, now: float, seconds: float = 0.0) -> list[list[int]]:
    return [chunk.ids for chunk in w.overdue(now, seconds)]


def test_a_request_without_any_progress_is_lost() -> None:
    assert lost(worker(), 10.5) == [[1, 2]]
    assert lost(worker(), 15.5) == [[1, 2], [3]]


def test_nothing_is_lost_while_evaluations_are_finished() -> None:
    assert lost(worker(progress=6.0), 15.5) == []


def test_requests_are_lost_later_if_evaluations_are_slow() -> None:
    assert lost(worker(), 39.5, seconds=2.0) == []
    assert lost(worker(), 40.5, seconds=2.0) == [[1, 2]]


def test_patience_doubles_with_each_loss() -> None:
    assert lost(worker(given_up=2), 40.5) == [[1, 2]]
    assert lost(worker(given_up=2), 39.5) == []


def test_a_request_that_takes_far_longer_than_expected_is_late() -> None:
    assert worker().late(now=6.5, seconds=0.5) == [1, 2]
    assert worker().late(now=6.5, seconds=1.0) == []


def requests(queued: int, evaluators: int, seconds: float) -> list[int]:
    """Return the sizes of requests, one after the other, until the queue is empty."""
    asked = []
    while queued:
        asked.append(share(queued, evaluators, seconds))
        queued -= asked[-1]
    assert queued == 0
    return asked


@pytest.mark.parametrize("seconds", [0.0, 1.0])
def test_long_or_unknown_evaluations_are_divided_into_ever_smaller_parts(seconds: float) -> None:
    asked = requests(100, 2, seconds)
    assert asked[0] == 25
    assert asked[-4:] == [1, 1, 1, 1]
    assert all(a >= b for a, b in pairwise(asked))


def test_short_evaluations_are_not_requested_one_by_one() -> None:
    asked = requests(100, 2, WORTHWHILE / 6)
    assert min(asked[:-4]) >= 6
    assert len(asked) < len(requests(100, 2, 1.0))


def test_few_short_evaluations_are_shared_by_all() -> None:
    assert requests(8, 4, WORTHWHILE / 100) == [2, 2, 1, 1, 1, 1]
    assert requests(3, 32, WORTHWHILE / 100) == [1, 1, 1]


@pytest.mark.parametrize(
    ("task", "versions", "words"),
    [
        ("qd_hopper", "python 3.11, numpy 2.4.6, pybullet 3.2.7", ""),
        ("qd_ant", "python 3.11, numpy 2.4.6", "it has task 'qd_ant', this run needs 'qd_hopper'"),
        (
            "qd_hopper",
            "python 3.12, numpy 2.4.6, pybullet 3.2.7",
            "it has python 3.12, this run needs python 3.11 to give the same results; start it",
        ),
        ("qd_hopper", "python 3.11", "this run needs numpy 2.4.6, pybullet 3.2.7 to give"),
    ],
)
def test_an_evaluator_of_another_task_python_or_library_is_told_what_differs(
    task: str, versions: str, words: str
) -> None:
    job = Job("run", "qd_hopper", 0, (1, 1), 1, "python 3.11, numpy 2.4.6, pybullet 3.2.7")
    reason = job.why_not(task, versions)
    assert words in reason
    assert bool(reason) == bool(words)
    assert "\n" not in reason
