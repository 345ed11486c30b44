"""Child processes that die are restarted until that is clearly useless."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pga_me_ros.orchestration.children import CRASH_LIMIT, KILL_LIMIT, ChildError, Children

LIVES = "input()"
NAME = "node"


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    with (tmp_path / "lock").open("w") as lock:
        children = Children(tmp_path, [], lock.fileno())
        yield children
        children.stop(at_once=True)


def started(children: Children, program: str) -> None:
    children.run(NAME, [sys.executable, "-c", program])


def die(children: Children, number: signal.Signals | None = None) -> None:
    """Wait for the present process to end, after a signal if one is given, and start the next one."""
    pid = children.pid(NAME)
    if number is not None:
        os.kill(pid, number)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    assert children.revive() == [NAME]


def test_the_error_for_a_child_that_crashes_repeatedly_has_its_last_output(
    children: Children, tmp_path: Path
) -> None:
    started(children, "import os; print('no servo answers'); exit(3)")
    for _ in range(CRASH_LIMIT - 1):
        die(children)
    with pytest.raises(ChildError) as raised:
        die(children)
    assert str(raised.value) == (
        "Node 'node' crashed 5 times without completing a generation, the last time with exit code 3; "
        f"its last output: 'no servo answers'. See {tmp_path}/logs/node.log."
    )


def test_a_child_that_the_machine_cannot_start_again_is_reported_with_the_reason(
    children: Children, tmp_path: Path
) -> None:
    started(children, "exit(3)")
    log = tmp_path / "logs" / "node.log"
    log.unlink()
    log.mkdir()
    words = f"^Node 'node' cannot be started: '{log}': Is a directory. Check memory, disk, and"
    with pytest.raises(ChildError, match=words):
        die(children)


def test_output_of_an_earlier_process_is_not_reported(children: Children, tmp_path: Path) -> None:
    (tmp_path / "logs" / "node.log").write_text("all is well\n")
    started(children, LIVES)
    for _ in range(CRASH_LIMIT - 1):
        die(children, signal.SIGTERM)
    with pytest.raises(ChildError, match=r"the last time by SIGTERM; it printed nothing\. See"):
        die(children, signal.SIGTERM)


def test_a_child_that_works_may_be_killed_any_number_of_times(children: Children) -> None:
    started(children, LIVES)
    for _ in range(KILL_LIMIT + 2):
        children.working(NAME, children.pid(NAME))
        die(children, signal.SIGKILL)
    assert children.restarts == KILL_LIMIT + 2


def test_a_child_that_is_repeatedly_killed_before_it_works_ends_the_run(children: Children) -> None:
    started(children, LIVES)
    for _ in range(KILL_LIMIT - 1):
        die(children, signal.SIGKILL)
    with pytest.raises(
        ChildError, match=r"crashed 20 times .* by SIGKILL, perhaps because memory ran"
    ):
        die(children, signal.SIGKILL)


def test_crashes_are_forgotten_when_a_generation_ends_and_the_child_has_worked(
    children: Children,
) -> None:
    started(children, LIVES)
    for _ in range(2 * CRASH_LIMIT):
        die(children, signal.SIGTERM)
        children.working(NAME, children.pid(NAME))
        children.progressed()


def test_crashes_are_remembered_while_only_others_make_progress(children: Children) -> None:
    started(children, LIVES)
    for _ in range(CRASH_LIMIT - 1):
        former = children.pid(NAME)
        die(children, signal.SIGTERM)
        children.working(NAME, former)
        children.progressed()
    with pytest.raises(ChildError):
        die(children, signal.SIGTERM)
