"""Locks that outlive the process that took them, held by its children."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pga_me_ros.core.storage.file_lock import FileLock, LockedError

LONG = float("inf")

PARENT = """
import subprocess, sys
from pathlib import Path
from pga_me_ros.core.storage.file_lock import FileLock

lock = FileLock(Path(sys.argv[1]))
subprocess.Popen(["cat"], pass_fds=[lock.fileno()])  # keeps the lock that it inherits until its input ends
print("locked", flush=True)
if sys.argv[2] == "stays":
    sys.stdin.read()
"""


@contextmanager
def holder(path: Path, what: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process that takes the lock, then stays or exits; its child has the lock until the input is closed."""
    command = [sys.executable, "-c", PARENT, str(path), what]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.readline() == b"locked\n"
        if what == "leaves":
            process.wait()
        yield process
        process.stdin.close()


def test_the_lock_waits_for_orphans_of_a_dead_holder(tmp_path: Path) -> None:
    path = tmp_path / "run.lock"
    with holder(path, "leaves") as process:
        with pytest.raises(LockedError, match=f"pid {process.pid} on .*, or choose another folder"):
            FileLock(path)
        assert process.stdin is not None
        end = threading.Timer(0.2, process.stdin.close)
        end.start()
        FileLock(path, orphans=LONG).release()
        end.join()


def test_the_lock_waits_less_for_a_living_holder_than_for_orphans(tmp_path: Path) -> None:
    path = tmp_path / "run.lock"
    with (
        holder(path, "stays") as process,
        pytest.raises(LockedError, match=f"pid {process.pid} on"),
    ):
        FileLock(path, orphans=LONG)
