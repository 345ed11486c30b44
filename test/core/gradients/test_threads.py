"""Threads that use idle cores: everything is done exactly once, and no result depends on their number."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from pga_me_ros.core.gradients import threads
from pga_me_ros.core.gradients.threads import (
    GoesOn,
    PairOfThreads,
    idle_cores,
    run_with_helpers,
)

PATIENCE = 30.0


@pytest.fixture
def unread() -> Iterator[None]:
    """Reset the machine's load as known to this process, before and after."""
    threads._open_load.cache_clear()
    yield
    threads._open_load.cache_clear()


def busy() -> list[subprocess.Popen[bytes]]:
    """Start one process per core that keeps it busy."""
    program = "print(flush=True)\nwhile True: pass"
    started = [
        subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
        for _ in range(os.cpu_count() or 1)
    ]
    for process in started:
        assert process.stdout
        process.stdout.readline()
    return started


def test_no_core_is_idle_if_all_are_in_use() -> None:
    others = busy()
    try:
        assert idle_cores() < 0
    finally:
        for process in others:
            process.kill()
            process.communicate()


@pytest.mark.usefixtures("unread")
def test_the_system_counts_the_caller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = tmp_path / "loadavg"
    monkeypatch.setattr(threads, "LOAD_FILE", str(load))
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    load.write_text("0.92 2.17 2.31 1/179 17945\n")
    assert idle_cores() == 3
    load.write_text("10.92 2.17 2.31 12/179 17945\n")
    assert idle_cores() == -8


@pytest.mark.usefixtures("unread")
def test_a_system_without_this_information_counts_as_idle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threads, "LOAD_FILE", str(tmp_path / "absent"))
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    assert idle_cores() == 3


class Counting:
    """Parts 0 to n - 1 of some work; each waits until a given number of threads have worked at the same time."""

    def __init__(self, parts: int, together: int = 1) -> None:
        self._todo = iter(range(parts))
        self._meeting = threading.Barrier(together)
        self.done: list[int] = []
        self.workers: set[int] = set()

    def __call__(self, goes_on: GoesOn) -> None:
        for part in self._todo:
            self.done.append(part)
            self.workers.add(threading.get_ident())
            self._meeting.wait(PATIENCE)
            if not goes_on():
                break


def test_each_idle_core_gets_a_helper(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "idle_cores", lambda: 2)
    work = Counting(30, together=3)
    run_with_helpers(work, helpers=5)
    assert sorted(work.done) == list(range(30))


def test_there_are_no_more_helpers_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "idle_cores", lambda: 63)
    work = Counting(30, together=3)
    run_with_helpers(work, helpers=2)
    assert sorted(work.done) == list(range(30))
    assert len(work.workers) == 3


@pytest.mark.parametrize("idle", [0, -3])
def test_without_an_idle_core_there_is_no_helper(
    monkeypatch: pytest.MonkeyPatch, idle: int
) -> None:
    monkeypatch.setattr(threads, "idle_cores", lambda: idle)
    work = Counting(5)
    run_with_helpers(work, helpers=2)
    assert work.done == list(range(5))
    assert work.workers == {threading.get_ident()}


def test_a_helper_stops_when_threads_wait_for_a_core(monkeypatch: pytest.MonkeyPatch) -> None:
    here = threading.get_ident()
    monkeypatch.setattr(threads, "idle_cores", lambda: 1 if threading.get_ident() == here else -1)
    parts_of_helpers: list[int] = []

    def work(goes_on: GoesOn) -> None:
        for part in todo:
            if threading.get_ident() != here:
                parts_of_helpers.append(part)
                helped.set()
            else:
                helped.wait(PATIENCE)
            if not goes_on():
                return
            assert threading.get_ident() == here

    todo, helped = iter(range(10)), threading.Event()
    run_with_helpers(work, helpers=1)
    assert parts_of_helpers
    assert next(todo, None) is None


def test_an_exception_in_a_helper_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "idle_cores", lambda: 1)
    here = threading.get_ident()

    def work(goes_on: GoesOn) -> None:
        assert goes_on()
        if threading.get_ident() != here:
            raise ValueError("no torch here")

    with pytest.raises(ValueError, match="no torch here"):
        run_with_helpers(work, helpers=1)


@pytest.fixture
def idle_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pretend that a core is idle, whatever else this machine does."""
    monkeypatch.setattr(threads, "idle_cores", lambda: 1)


@pytest.mark.parametrize(("idle", "used"), [(1, 2), (0, 1), (-1, 1)])
def test_jobs_run_in_parallel_only_if_a_core_is_idle(
    monkeypatch: pytest.MonkeyPatch, idle: int, used: int
) -> None:
    monkeypatch.setattr(threads, "idle_cores", lambda: idle)
    done: list[int] = []
    PairOfThreads(2, 1)(*2 * [lambda: done.append(threading.get_ident())])
    assert len(done) == 2
    assert len(set(done)) == used


@pytest.mark.usefixtures("idle_machine")
@pytest.mark.parametrize("jobs", [2, 3])
def test_all_jobs_are_done_before_the_next_ones_start(jobs: int) -> None:
    done = [0] * jobs
    pair = PairOfThreads(2, 1)

    def job(i: int, turn: int) -> None:
        assert done[i] == turn
        done[i] += 1

    for turn in range(3000):
        pair(*(partial(job, i, turn) for i in range(jobs)))
        assert done == [turn + 1] * jobs


@pytest.mark.usefixtures("idle_machine")
def test_a_job_may_wait_for_one_before_it() -> None:
    pair, passed = PairOfThreads(2, 1), []
    for number in range(1000):
        stepped = threading.Event()

        def follow(number: int = number, stepped: threading.Event = stepped) -> None:
            assert stepped.wait(PATIENCE)
            passed.append(number)

        pair(stepped.set, follow)
    assert passed == list(range(1000))


@pytest.mark.usefixtures("idle_machine")
@pytest.mark.parametrize("caller_fails", [False, True])
def test_an_exception_in_a_job_is_raised_after_all_have_ended(caller_fails: bool) -> None:
    pair, ended = PairOfThreads(2, 1), []

    def fail() -> None:
        ended.append(1)
        raise ValueError("no torch here")

    other = fail if caller_fails else lambda: ended.append(2)
    with pytest.raises(ValueError, match="no torch here"):
        pair(fail, other)
    assert len(ended) == 2
    pair(lambda: ended.append(3), lambda: ended.append(4))
    assert sorted(ended)[-2:] == [3, 4]


@pytest.mark.usefixtures("idle_machine")
def test_the_second_thread_ends_with_its_owner() -> None:
    before = set(threading.enumerate())
    pair = PairOfThreads(2, 1)
    pair(lambda: None, lambda: None)
    (second,) = set(threading.enumerate()) - before
    del pair
    gc.collect()
    second.join(PATIENCE)
    assert not second.is_alive()
