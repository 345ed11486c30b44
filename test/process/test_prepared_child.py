"""A child that is started early does nothing until it is told to begin, and ends when its parent does."""

from __future__ import annotations

import fcntl
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pga_me_ros.process.parent_watch import EXIT_ORPHANED
from pga_me_ros.process.prepared_child import PreparedChild

NODE = """
import sys
import pga_me_ros.nodes
from pga_me_ros.process.parent_watch import wait_for_word

print("imported", flush=True)
wait_for_word()
print("begun", flush=True)
if "stay" in sys.argv:
    input()
exit(3)
"""
"""What a node does: it watches its parent, imports its libraries, waits for the word."""


COUNTING = """
import os
from pga_me_ros.process import parent_watch

parent_watch.watch_parent()
number = 0
while not parent_watch._told.is_set():
    os.write(1, b"%d\\n" % number)
    number += 1
parent_watch.wait_for_word()
os.write(1, b"%d\\n" % number)
"""
"""Prints in one thread while the other hears the word."""

FAILING = """
import sys
import pga_me_ros.nodes
from pga_me_ros.process import parent_watch

parent_watch._told.wait()
sys.exit("no servo answers")
"""
"""Ends after the word has come, before it waits for it, as with a library that is damaged."""


@pytest.fixture
def prepared() -> Iterator[PreparedChild]:
    child = PreparedChild([sys.executable, "-c", NODE, "stay"])
    yield child
    child.send(signal.SIGKILL)
    child.wait()
    child.close_input()


def test_it_begins_when_it_is_told_and_all_its_output_is_in_the_log(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("an earlier process\n")
    child = PreparedChild([sys.executable, "-c", NODE])
    assert child.begin(log)
    assert child.wait()
    assert child.exit_code == 3
    assert log.read_text() == "an earlier process\nimported\nbegun\n"
    assert child.last_words() == "begun"
    child.close_input()


def test_nothing_is_lost_or_moved_that_is_printed_while_the_word_is_heard(tmp_path: Path) -> None:
    child = PreparedChild([sys.executable, "-c", COUNTING])
    assert child.begin(tmp_path / "log")
    assert child.wait()
    counted = [int(line) for line in (tmp_path / "log").read_text().splitlines()]
    assert counted == list(range(len(counted)))
    assert counted
    child.close_input()


def test_output_of_one_that_ends_before_it_waits_is_in_the_log(tmp_path: Path) -> None:
    child = PreparedChild([sys.executable, "-c", FAILING])
    assert child.begin(tmp_path / "log")
    assert child.wait()
    assert (tmp_path / "log").read_text() == "no servo answers\n"
    child.close_input()


def test_words_of_one_that_ends_before_it_hears_are_known(tmp_path: Path) -> None:
    program = "import os; print('error: no servo answers', flush=True); os.read(0, 1)"
    child = PreparedChild([sys.executable, "-c", program])
    assert child.begin(tmp_path / "log")
    assert child.wait()
    assert child.last_words() == "no servo answers"
    child.close_input()


def test_it_ends_with_its_parent_while_it_waits(prepared: PreparedChild) -> None:
    prepared.close_input()
    assert prepared.wait()
    assert prepared.exit_code == EXIT_ORPHANED


def test_it_keeps_a_lock_from_the_word_on(prepared: PreparedChild, tmp_path: Path) -> None:
    with (tmp_path / "lock").open("w") as ours, (tmp_path / "lock").open("w") as other:
        fcntl.flock(ours, fcntl.LOCK_EX)
        assert prepared.begin(tmp_path / "log", (ours.fileno(),))
        ours.close()
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        prepared.send(signal.SIGKILL)
        assert prepared.wait()
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_one_that_has_ended_cannot_begin(prepared: PreparedChild, tmp_path: Path) -> None:
    os.kill(prepared.pid, signal.SIGKILL)
    assert prepared.wait()
    assert not prepared.begin(tmp_path / "log")


def test_a_signal_ends_it_while_it_waits(prepared: PreparedChild) -> None:
    prepared.send(signal.SIGTERM)
    assert prepared.wait()
    assert prepared.exit_code in (0, -signal.SIGTERM)
