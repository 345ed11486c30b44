"""The roster: which of a run's processes have been heard, and which have gone silent."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pga_me_msgs.msg import NodeStatus

from pga_me_ros.orchestration import roster as module
from pga_me_ros.orchestration.children import Children
from pga_me_ros.orchestration.roster import Roster

NAMES = ("archive_manager", "variation")


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    with (tmp_path / "lock").open("w") as lock:
        children = Children(tmp_path, [], lock.fileno())
        for name in NAMES:
            children.run(name, [sys.executable, "-c", "input()"])
        yield children
        children.stop(at_once=True)


@pytest.fixture
def roster(children: Children) -> Roster:
    return Roster(children, "/lab")


def heartbeat(children: Children, name: str, **more: object) -> NodeStatus:
    values = {"pid": children.pid(name), "host": socket.gethostname(), "node": f"/lab/{name}"}
    return NodeStatus(**{**values, **more})


def restart(children: Children, name: str) -> None:
    pid = children.pid(name)
    os.kill(pid, signal.SIGTERM)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    assert children.revive() == [name]


def wait_until(true: Callable[[], bool]) -> None:
    deadline, pause = time.monotonic() + 30.0, threading.Event()
    while not true():
        assert time.monotonic() < deadline
        pause.wait(0.01)


def test_all_are_up_once_the_present_process_of_each_has_been_heard(
    children: Children, roster: Roster
) -> None:
    assert not roster.all_up
    former = heartbeat(children, NAMES[1])
    for name in NAMES * 2:
        assert roster.heard(heartbeat(children, name))
    assert (roster.all_up, roster.arrivals) == (True, 2)
    restart(children, NAMES[1])
    assert roster.heard(former)  # its last heartbeat may come late
    assert not roster.all_up
    assert roster.heard(heartbeat(children, NAMES[1]))
    assert (roster.all_up, roster.arrivals) == (True, 3)


def test_strangers_leave_no_trace(children: Children, roster: Roster) -> None:
    stranger = heartbeat(children, NAMES[0], pid=os.getpid(), refused=9)
    elsewhere = heartbeat(children, NAMES[0], host="elsewhere", refused=9)
    assert not roster.heard(stranger)
    assert not roster.heard(elsewhere)
    assert (roster.arrivals, roster.refused, roster.all_up) == (0, 0, False)


def test_refusals_of_replaced_processes_still_count(children: Children, roster: Roster) -> None:
    roster.heard(heartbeat(children, NAMES[0], refused=3))
    roster.heard(heartbeat(children, NAMES[1], refused=1))
    restart(children, NAMES[0])
    roster.heard(heartbeat(children, NAMES[0], refused=2))
    roster.heard(heartbeat(children, NAMES[0], refused=4))
    assert roster.refused == 3 + 1 + 4


def test_silence_is_reported_for_children_that_were_heard(
    children: Children, roster: Roster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "STALE", 0.05)
    monkeypatch.setattr(module, "HANGING", 0.1)
    roster.heard(heartbeat(children, NAMES[0]))
    wait_until(lambda: roster.hanging(NAMES) == {NAMES[0]})
    assert list(roster.stale()) == [NAMES[0]]
    assert roster.stale()[NAMES[0]] > 0.1
    restart(children, NAMES[0])  # its start may take a while, but meanwhile nobody answers
    assert roster.hanging(NAMES) == set()
    assert list(roster.stale()) == [NAMES[0]]
