"""Two threads that meet again and again: nothing is done twice or lost, be they awake or asleep."""

from __future__ import annotations

import gc
import threading

import pytest

from pga_me_ros.core import event_count, side_by_side
from pga_me_ros.core.event_count import EventCount
from pga_me_ros.core.side_by_side import SideBySide

PATIENCE = 30.0


@pytest.fixture(autouse=True)
def idle_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a core free, whatever else this machine does."""
    monkeypatch.setattr(side_by_side, "spare_cores", lambda: 1)


@pytest.mark.parametrize(("spare", "threads"), [(1, 2), (0, 1), (-1, 1)])
def test_works_are_done_side_by_side_only_where_a_core_is_free(
    monkeypatch: pytest.MonkeyPatch, spare: int, threads: int
) -> None:
    monkeypatch.setattr(side_by_side, "spare_cores", lambda: spare)
    done: list[int] = []
    SideBySide(2, 1)(*2 * [lambda: done.append(threading.get_ident())])
    assert len(done) == 2
    assert len(set(done)) == threads


@pytest.mark.parametrize("looks", [0, 1, 20, 2000])
def test_all_works_are_done_before_the_next_ones_are_given(
    monkeypatch: pytest.MonkeyPatch, looks: int
) -> None:
    monkeypatch.setattr(event_count, "LOOKS", looks)
    done = [0, 0]
    both = SideBySide(2, 1)

    def work(i: int, turn: int) -> None:
        assert done[i] == turn
        done[i] += 1

    for turn in range(3000):
        both(lambda: work(0, turn), lambda: work(1, turn))  # noqa: B023
        assert done == [turn + 1, turn + 1]


@pytest.mark.parametrize("looks", [0, 2000])
def test_a_work_may_wait_for_one_before_it(monkeypatch: pytest.MonkeyPatch, looks: int) -> None:
    monkeypatch.setattr(event_count, "LOOKS", looks)
    both, steps, seen = SideBySide(2, 1), EventCount(), []
    for number in range(1, 1000):
        both(steps.advance, lambda: (steps.wait_for(number), seen.append(number)))  # noqa: B023
    assert seen == list(range(1, 1000))


def test_a_sleeper_is_woken() -> None:
    asleep, count = threading.Event(), EventCount()

    def look(number: int) -> bool:
        asleep.set()
        return count.count >= number

    count.look_for = look  # type: ignore[method-assign]
    reader = threading.Thread(target=count.wait_for, args=(2,))
    reader.start()
    assert asleep.wait(PATIENCE)
    count.advance()
    count.advance()
    reader.join(PATIENCE)
    assert not reader.is_alive()


@pytest.mark.parametrize("caller_fails", [False, True])
def test_what_a_work_raises_is_raised_once_all_have_ended(caller_fails: bool) -> None:
    both, ended = SideBySide(2, 1), []

    def fail() -> None:
        ended.append(1)
        raise ValueError("no torch here")

    other = fail if caller_fails else lambda: ended.append(2)
    with pytest.raises(ValueError, match="no torch here"):
        both(fail, other)
    assert len(ended) == 2
    both(lambda: ended.append(3), lambda: ended.append(4))
    assert sorted(ended)[-2:] == [3, 4]


def test_the_helper_ends_with_its_owner() -> None:
    before = set(threading.enumerate())
    both = SideBySide(2, 1)
    both(lambda: None, lambda: None)
    (helper,) = set(threading.enumerate()) - before
    del both
    gc.collect()
    helper.join(PATIENCE)
    assert not helper.is_alive()
