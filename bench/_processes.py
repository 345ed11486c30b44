"""Starts a run and observes its processes; shared by the benches of the graph. Not a bench itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from _run_times import committed

HERE = Path(__file__).resolve().parent
MODULE_PREFIX = "pga_me_ros.nodes."


def start_run(
    folder: str, values: Mapping[str, object], tree: Path | None = None, **variables: str
) -> subprocess.Popen[bytes]:
    """Start the orchestrator; its progress is discarded, its errors go to the terminal.

    Args:
        folder: Folder of the run.
        values: Parameters; the task may be one of those in bench/.
        tree: Clone whose code and environment run; this process's by default.
        variables: Further environment variables of its processes.
    """
    command = ["-m", f"{MODULE_PREFIX}orchestrator", "--ros-args"]
    for name, value in {**values, "run_dir": folder}.items():
        command += ["-p", f"{name}:={value}"]
    path = os.pathsep.join(filter(None, [str(HERE), os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, "PYTHONPATH": path, **variables}
    if tree:
        return python_of(tree, *command, stdout=subprocess.DEVNULL)
    return subprocess.Popen([sys.executable, *command], stdout=subprocess.DEVNULL, env=environment)


@contextmanager
def running(
    folder: str, values: Mapping[str, object], **variables: str
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a run as `start_run` does; one that is still going on at the end is stopped."""
    process = start_run(folder, values, **variables)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            process.wait()


def python_of(
    tree: Path, *arguments: str, variables: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[Any]:
    """Start the Python of a clone that is set up, in an environment of its own.

    This process's environment names another clone: the ROS wheels add their folders to it when Python starts.

    Args:
        tree: The clone.
        arguments: Arguments of Python.
        variables: Environment variables besides.
        options: Further arguments of `subprocess.Popen`.
    """
    kept = ("HOME", "LANG", "TMPDIR", "ROS_DOMAIN_ID")
    environment = {name: os.environ[name] for name in kept if name in os.environ}
    environment["PATH"] = os.defpath
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    environment |= variables or {}
    command = ["bash", "-c", '. "$0/.venv/setup.bash" && exec python "$@"', str(tree), *arguments]
    return subprocess.Popen(command, cwd=tree, env=environment, **options)


def wait_for_generation(process: subprocess.Popen[bytes], file: Path, generation: int) -> None:
    """Wait until a run has committed a generation to its repertoire file."""
    while len(committed(file)) <= generation:
        if process.poll() not in (None, 0):
            raise SystemExit(f"the orchestrator ended with {process.returncode}")
        time.sleep(0.1)  # no event tells that another process has written to the file


def kinds_of_processes(orchestrator: int) -> list[tuple[int, str]]:
    """Return process id and kind, such as 'evaluator', of each of a run's processes; without those that have ended."""
    out = []
    for pid in [orchestrator, *children_of(orchestrator)]:
        try:
            arguments = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
        modules = [a.removeprefix(MODULE_PREFIX) for a in arguments if a.startswith(MODULE_PREFIX)]
        out += [(pid, module) for module in modules[:1]]
    return out


def core_seconds(orchestrator: int) -> dict[str, float]:
    """Return the core seconds used by each kind of process of a run."""
    out: dict[str, float] = {}
    for pid, kind in kinds_of_processes(orchestrator):
        out[kind] = out.get(kind, 0.0) + _used(Path(f"/proc/{pid}"))
    return out


def core_seconds_beside(orchestrator: int) -> float:
    """Return the core seconds used by all processes that this one has started, except those of a run."""
    used, left = 0.0, [pid for pid in children_of(os.getpid()) if pid != orchestrator]
    while left:
        pid = left.pop()
        used += _used(Path(f"/proc/{pid}"))
        left += children_of(pid)
    return used


def listening_seconds(orchestrator: int) -> dict[str, float]:
    """Return the core seconds of the threads that send and receive: the first one and those of Fast DDS.

    All other threads of a process do its work.
    """
    out: dict[str, float] = {}
    for pid, kind in kinds_of_processes(orchestrator):
        for thread in _threads(pid):
            if thread.name == str(pid) or _name(thread).startswith("dds."):
                out[kind] = out.get(kind, 0.0) + _used(thread)
    return out


def idle_seconds() -> float:
    """Return the idle seconds of this machine since its start, summed over its cores."""
    with Path("/proc/stat").open() as lines:  # "cpu  user nice system idle iowait ..."
        times = next(lines).split()[1:]
    return (int(times[3]) + int(times[4])) / os.sysconf("SC_CLK_TCK")


def _used(process: Path) -> float:
    """Return the core seconds of a process or thread, 0 if it has ended."""
    try:
        stat = (process / "stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def _name(thread: Path) -> str:
    try:
        return (thread / "comm").read_text()
    except OSError:
        return ""


def _threads(pid: int) -> list[Path]:
    try:
        return list(Path(f"/proc/{pid}/task").iterdir())
    except OSError:
        return []


def children_of(pid: int) -> list[int]:
    try:
        return [
            int(child)
            for thread in _threads(pid)
            for child in (thread / "children").read_text().split()
        ]
    except OSError:
        return []
