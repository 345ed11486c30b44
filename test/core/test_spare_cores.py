"""Threads that come and go with the load of the machine, and never change a result."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from pga_me_ros.core import helping_threads, spare_cores
from pga_me_ros.core.helping_threads import GoesOn, do_with_helpers

PATIENCE = 30.0


@pytest.fixture
def unread() -> Iterator[None]:
    """A process that has not looked for the machine's load yet, before and after."""
    spare_cores._load.cache_clear()
    yield
    spare_cores._load.cache_clear()


def busy() -> list[subprocess.Popen[bytes]]:
    """Start a process per core that does nothing but run."""
    program = "print(flush=True)\nwhile True: pass"
    started = [
        subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
        for _ in range(os.cpu_count() or 1)
    ]
    for process in started:
        assert process.stdout
        process.stdout.readline()
    return started


def test_no_core_is_spare_where_each_is_in_use() -> None:
    others = busy()
    try:
        assert spare_cores.spare_cores() < 0
    finally:
        for process in others:
            process.kill()
            process.communicate()


@pytest.mark.usefixtures("unread")
def test_the_system_counts_the_caller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = tmp_path / "loadavg"
    monkeypatch.setattr(spare_cores, "LOAD", str(load))
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    load.write_text("0.92 2.17 2.31 1/179 17945\n")
    assert spare_cores.spare_cores() == 3
    load.write_text("10.92 2.17 2.31 12/179 17945\n")
    assert spare_cores.spare_cores() == -8


@pytest.mark.usefixtures("unread")
def test_a_system_that_does_not_tell_is_taken_to_be_idle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spare_cores, "LOAD", str(tmp_path / "absent"))
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    assert spare_cores.spare_cores() == 3


class Counting:
    """Parts 0 to n - 1 of some work; each waits until as many threads as wanted have been at one together."""

    def __init__(self, parts: int, together: int = 1) -> None:
        self._todo = iter(range(parts))
        self._meeting = threading.Barrier(together)
        self.done: list[int] = []
        self.threads: set[int] = set()

    def __call__(self, goes_on: GoesOn) -> None:
        for part in self._todo:
            self.done.append(part)
            self.threads.add(threading.get_ident())
            self._meeting.wait(PATIENCE)
            if not goes_on():
                break


def test_each_core_that_is_free_gets_a_helper(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helping_threads, "spare_cores", lambda: 2)
    work = Counting(30, together=3)
    do_with_helpers(work, helpers=5)
    assert sorted(work.done) == list(range(30))


def test_helpers_are_called_no_more_than_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helping_threads, "spare_cores", lambda: 63)
    work = Counting(30, together=3)
    do_with_helpers(work, helpers=2)
    assert sorted(work.done) == list(range(30))
    assert len(work.threads) == 3


@pytest.mark.parametrize("spare", [0, -3])
def test_without_a_free_core_there_is_no_helper(
    monkeypatch: pytest.MonkeyPatch, spare: int
) -> None:
    monkeypatch.setattr(helping_threads, "spare_cores", lambda: spare)
    work = Counting(5)
    do_with_helpers(work, helpers=2)
    assert work.done == list(range(5))
    assert work.threads == {threading.get_ident()}


def test_a_helper_leaves_when_threads_wait_for_their_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    here = threading.get_ident()
    monkeypatch.setattr(
        helping_threads, "spare_cores", lambda: 1 if threading.get_ident() == here else -1
    )
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
    do_with_helpers(work, helpers=1)
    assert parts_of_helpers
    assert next(todo, None) is None


def test_what_goes_wrong_in_a_helper_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helping_threads, "spare_cores", lambda: 1)
    here = threading.get_ident()

    def work(goes_on: GoesOn) -> None:
        assert goes_on()
        if threading.get_ident() != here:
            raise ValueError("no torch here")

    with pytest.raises(ValueError, match="no torch here"):
        do_with_helpers(work, helpers=1)
