"""Child processes: their output is kept, their end is reported, and they notice the end of their parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pga_me_ros.process.child import ChildProcess, python_module


def child(log: Path, program: str, **more: object) -> ChildProcess:
    return ChildProcess([sys.executable, "-c", program], log, **more)


def test_last_words_are_the_last_line_of_this_process(tmp_path: Path) -> None:
    log = tmp_path / "log"
    first = child(log, "print('hello'); print('error: no servo answers'); print(); exit(3)")
    assert first.wait()
    assert (first.exit_code, first.last_words()) == (3, "no servo answers")
    second = child(log, "")
    assert second.wait()
    assert (second.exit_code, second.last_words()) == (0, "")


def test_waiting_for_it_can_time_out_and_it_can_be_sent_signals(tmp_path: Path) -> None:
    process = child(tmp_path / "log", "input()")
    assert not process.wait(0.01)
    assert process.alive
    process.send(signal.SIGTERM)
    assert process.wait()
    assert process.exit_code == -signal.SIGTERM
    process.send(signal.SIGTERM)
    process.kill_session()


def test_its_input_ends_when_it_is_closed_here(tmp_path: Path) -> None:
    process = child(tmp_path / "log", "import sys; sys.stdin.read(); print('the end')")
    process.close_input()
    assert process.wait()
    assert process.last_words() == "the end"


def test_it_gets_variables_and_files_and_watches_its_parent(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    program = (
        "import os; from pga_me_ros.process.parent_watch import PARENT_WATCH; "
        f"os.write({writing}, (os.environ['DOMAIN'] + os.environ[PARENT_WATCH]).encode())"
    )
    process = child(tmp_path / "log", program, inherited=(writing,), environment={"DOMAIN": "7"})
    assert process.wait()
    assert os.read(reading, 10) == b"71", process.last_words()
    os.close(reading)
    os.close(writing)


def test_killing_the_session_kills_its_children_too(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    program = (
        "import subprocess, sys, os; "
        f"subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1e6)'], pass_fds=({writing},)); "
        f"os.write({writing}, b'x'); input()"
    )
    process = child(tmp_path / "log", program, inherited=(writing,))
    os.close(writing)
    assert os.read(reading, 1) == b"x", process.last_words()
    process.kill_session()
    assert process.wait()
    assert os.read(reading, 1) == b""  # the last process that could write is gone
    os.close(reading)


@pytest.mark.parametrize("flags", [[], ["-P"]])
def test_modules_are_imported_from_the_same_places(flags: list[str]) -> None:
    program = (
        "from pga_me_ros.process.child import python_module; print(*python_module('m', 'x')[1:])"
    )
    done = subprocess.run(
        [sys.executable, *flags, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [*flags, "-m", "m", "x"]
    assert python_module("m")[0] == sys.executable
