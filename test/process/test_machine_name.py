"""A name that one process of this machine at a time can hold."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from pga_me_ros.process.machine_name import HeldNameError, MachineName

HOLD = """
import subprocess, sys
from pga_me_ros.process.machine_name import MachineName
held = MachineName(*sys.argv[1:])
child = subprocess.Popen(["cat"], stdout=subprocess.DEVNULL)
print(child.pid, flush=True)
child.wait()
"""
"""Holds a name, and has a child that lives until their standard input is closed."""

COMPETE = """
import os, sys
from pga_me_ros.process.machine_name import HeldNameError, MachineName
print("here", flush=True)
sys.stdin.readline()
try:
    held = MachineName(sys.argv[1])
    print("held", os.getpid(), flush=True)
except HeldNameError as error:
    print("refused", error.pid, flush=True)
sys.stdin.read()
"""
"""Takes a name at a word, and says what came of it."""


@pytest.fixture
def name() -> str:
    """Return a name that no other test has."""
    return uuid.uuid4().hex


def start(program: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )


def line(process: subprocess.Popen[str]) -> list[str]:
    """Return the words of a process's next line."""
    assert process.stdout
    return process.stdout.readline().split()


@contextmanager
def ending(*processes: subprocess.Popen[str]) -> Iterator[None]:
    """Kill processes at the end of a block."""
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def test_a_held_name_is_refused_with_its_holder_until_it_is_released(name: str) -> None:
    with MachineName(name, "of two parts"):
        for _ in range(3):
            with pytest.raises(HeldNameError) as refused:
                MachineName(name, "of two parts")
            assert refused.value.pid == os.getpid()
        MachineName(name, "of other parts").release()
        MachineName(name + "of two", " parts").release()
    with MachineName(name, "of two parts") as again:
        again.release()


def test_the_name_of_a_killed_process_is_free_although_its_child_lives(name: str) -> None:
    holder = start(HOLD, name)
    child = int(line(holder)[0])
    with ending(holder):
        with pytest.raises(HeldNameError) as refused:
            MachineName(name)
        assert refused.value.pid == holder.pid
        os.kill(holder.pid, signal.SIGSTOP)  # a process that is stopped for a while keeps its name
        with pytest.raises(HeldNameError):
            MachineName(name)
        holder.kill()
        holder.wait()
        MachineName(name).release()
        os.kill(child, 0)  # it lives


def test_of_many_that_start_at_once_one_holds_the_name_and_all_others_know_which(name: str) -> None:
    processes = [start(COMPETE, name) for _ in range(8)]
    with ending(*processes):
        for process in processes:
            assert line(process) == ["here"]
        for process in processes:
            assert process.stdin
            process.stdin.write("\n")
        said = [line(process) for process in processes]
    holder = next(pid for word, pid in said if word == "held")
    assert sorted(said) == sorted([["held", holder], *[["refused", holder]] * 7])


def test_a_holder_that_nobody_can_ask_is_unknown(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pga_me_ros.process.machine_name.BACKLOG", 0)
    with MachineName(name):
        pids = []
        for _ in range(3):
            with pytest.raises(HeldNameError) as refused:
                MachineName(name)
            pids.append(refused.value.pid)
    assert pids[0] == os.getpid()
    assert pids[-1] == 0


def test_where_such_sockets_are_denied_nothing_is_held(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def denied(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(socket.socket, "bind", denied)
    with MachineName(name), MachineName(name):
        pass
