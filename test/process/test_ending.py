"""A process that leaves without dismantling its libraries still keeps what it wrote."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os, sys, time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from pga_me_ros.process.ending import leave

class Library:
    def __del__(self, mkdir=os.mkdir):
        mkdir("dismantled")

def save():
    time.sleep(0.2)
    Path("saved").write_text("all of it")

library = Library()
sys.library = library
ThreadPoolExecutor(1).submit(save)
sys.stdout.write("output without a line's end")
{end}
"""


@pytest.mark.parametrize("status", [0, 2])
def test_threads_finish_output_is_written_and_nothing_is_dismantled(
    tmp_path: Path, status: int
) -> None:
    program = PROGRAM.format(end=f"leave({status})")
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True)
    assert (done.returncode, done.stderr) == (status, b"")
    assert done.stdout == b"output without a line's end"
    assert (tmp_path / "saved").read_text() == "all of it"
    assert not (tmp_path / "dismantled").exists()


def test_python_itself_would_dismantle_it(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", PROGRAM.format(end="")], cwd=tmp_path, check=True)
    assert (tmp_path / "dismantled").exists()


def test_output_that_cannot_be_written_does_not_change_the_status() -> None:
    program = "from pga_me_ros.process.ending import leave; print('hello'); leave(3)"
    with open("/dev/full", "wb") as full:
        buffered = {**os.environ, "PYTHONUNBUFFERED": ""}
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, stdout=full, stderr=full, env=buffered)
    assert done.returncode == 3
