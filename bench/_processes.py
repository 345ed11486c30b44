"""Starting a run and looking at its processes; shared by the benches of the graph, no bench itself."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

MODULE_PREFIX = "pga_me_ros.nodes."


def start_run(folder: str, values: Mapping[str, object]) -> subprocess.Popen[bytes]:
    """Start the orchestrator with some parameters; its progress goes nowhere, its errors to the terminal."""
    command = [sys.executable, "-m", f"{MODULE_PREFIX}orchestrator", "--ros-args"]
    for name, value in {**values, "run_dir": folder}.items():
        command += ["-p", f"{name}:={value}"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def kinds_of_processes(orchestrator: int) -> list[tuple[int, str]]:
    """Return the process ids of a run and what each is, as 'evaluator'; without what has ended meanwhile."""
    out = []
    for pid in [orchestrator, *_children_of(orchestrator)]:
        try:
            arguments = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
        modules = [a.removeprefix(MODULE_PREFIX) for a in arguments if a.startswith(MODULE_PREFIX)]
        out += [(pid, module) for module in modules[:1]]
    return out


def core_seconds(orchestrator: int) -> dict[str, float]:
    """Return the core seconds that each kind of process of a run has used."""
    ticks = os.sysconf("SC_CLK_TCK")
    out: dict[str, float] = {}
    for pid, kind in kinds_of_processes(orchestrator):
        try:
            stat = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        out[kind] = out.get(kind, 0.0) + (int(stat[11]) + int(stat[12])) / ticks
    return out


def _children_of(pid: int) -> list[int]:
    try:
        return [
            int(child)
            for task in Path(f"/proc/{pid}/task").iterdir()
            for child in (task / "children").read_text().split()
        ]
    except OSError:
        return []
