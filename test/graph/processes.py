"""The child processes of a run, as the operating system sees them."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from graph import Started, wait_until

LEAVE = 10.0
"""Seconds within which the children of a killed orchestrator must be gone."""


def children(run_dir: Path) -> dict[str, int]:
    """Return process ids of a run's living children by node name."""
    mark = f"{run_dir}/parameters/"
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                words = (folder / "cmdline").read_bytes().decode().split("\0")
            except OSError:
                continue  # it has ended
            name = next((w.split(":=")[1] for w in words if w.startswith("__node:=")), "")
            if name and any(w.startswith(mark) for w in words):
                found[name] = int(folder.name)
    return found


def kill_child(run_dir: Path, name: str) -> None:
    """Kill a child as the kernel would if memory ran out, and wait for its successor."""
    pid = children(run_dir)[name]
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: children(run_dir).get(name, pid) != pid, f"a new {name}")


def wait_for_no_children(run_dir: Path) -> None:
    """Wait until no child of a run is left."""
    wait_until(lambda: not children(run_dir), f"the end of {children(run_dir)}", LEAVE)


def kill_orchestrator(run: Started) -> None:
    """Kill only the orchestrator."""
    run.process.kill()
    run.process.wait()
