"""Where the time from a run's command to the end of its first episode goes.

Run: `.venv/bin/python bench/startup.py [--rounds 3] [--older CLONE] [--cores N]`; the last line is JSON. It starts the
orchestrator as a user does (two evaluators, Table 1 otherwise), in a ROS domain and a folder of its own, and stops it
after the first episode. `--older` also starts that of another clone that is set up, `--cores 1` keeps all processes on
one core. The reference is the same run in one process, `core.search`. All are measured in turn, in one order and then
in the reverse one, and each figure is printed for both orders, since a start finds its files in memory if another came
just before.

The parts of the main line follow one another and add up to the whole time. What the children do lies beside it: their
table says when each of their parts ended, as a share of the whole time, and how much core time a child had used by its
heartbeat. Parts are timed by wrapping functions as they are loaded (`_startup_marks/sitecustomize.py`).
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _measure import spread
from _processes import HERE, MODULE_PREFIX, children_of, python_of
from domain_coordinator import domain_id

TASK = "qd_hopper"
EVALUATORS = 2
LONGEST = 300.0
"""Seconds after which a start counts as failed."""

SEARCH = f"""
from pga_me_ros import Search, Settings, make_task
settings = Settings(task="{TASK}", seed=1, evaluations=20_000)
task = make_task(settings.task)
Search(task.spec, settings).run_generation(task)
"""

MAIN_LINE = (
    ("interpreter", "interpreter", "ended"),
    ("imports of the orchestrator", "init begins", "began"),
    ("ROS and the orchestrator's node", "require_free_name begins", "began"),
    ("listening for namesakes", "require_free_name", "ended"),
    ("cells, folder of the run", "open_run", "ended"),
)
"""Parts of the orchestrator's own start, in order: name, and the mark at which the part is over."""

PARTS_OF_CHILDREN = (
    ("process", ("interpreter",), "began"),
    ("imports", ("wait_for_word begins", "init begins"), "began"),
    ("word", ("wait_for_word",), "ended"),
    ("ROS", ("init",), "ended"),
    ("world", ("make_task",), "ended"),
    ("heartbeat", ("GraphNode.start_heartbeat",), "ended"),
    ("torch", ("import torch",), "ended"),
)
"""Columns of the children's table: name, and the mark at which the part is over, the first of these that is there."""


@dataclass(frozen=True)
class Started:
    """What is known of one start.

    Attributes:
        seconds: Time from the command to the end of the first episode.
        parts: Seconds of each part of the main line, in order; empty for the reference.
        children: By node, when its parts ended, s after the command.
        core: By node, core seconds used by its heartbeat.
        cvt: Seconds for the centroids of the archive.
    """

    seconds: float
    parts: dict[str, float]
    children: dict[str, dict[str, float]]
    core: dict[str, float]
    cvt: float


class Recording:
    """The marks of all processes of one start."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.names: dict[int, str] = {}

    def read(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return the marks so far, by node and part."""
        out: dict[str, dict[str, dict[str, Any]]] = {}
        for file in self._folder.glob("*.jsonl"):
            name = self.names.get(int(file.stem), file.stem)
            lines = file.read_text().splitlines()
            out[name] = {mark["part"]: mark for mark in map(json.loads, lines)}
        return out

    def first_episode(self) -> float | None:
        """Return when the first episode ended, None if none has yet."""
        ends = [marks["rollout"]["ended"] for marks in self.read().values() if "rollout" in marks]
        return min(ends, default=None)


def start(tree: Path, *, graph: bool, cores: set[int]) -> Started:
    """Start a run and stop it after its first episode.

    Args:
        tree: Clone whose code runs.
        graph: Whether the orchestrator starts, rather than the search in one process.
        cores: Cores that its processes may use.
    """
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        tempfile.TemporaryDirectory() as marks,
        domain_id() as domain,
    ):
        command = ["-c", SEARCH]
        if graph:
            command = ["-m", f"{MODULE_PREFIX}orchestrator", "--ros-args"]
            values = {"task": TASK, "seed": 1, "evaluations": 20_000, "evaluators": EVALUATORS}
            for name, value in {**values, "run_dir": f"{folder}/run"}.items():
                command += ["-p", f"{name}:={value}"]
        variables = {
            "PYTHONPATH": str(HERE / "_startup_marks"),
            "STARTUP_MARKS": marks,
            "ROS_DOMAIN_ID": str(domain),
        }
        recording = Recording(Path(marks))
        began = time.clock_gettime(time.CLOCK_BOOTTIME)
        process = python_of(
            tree,
            *command,
            variables=variables,
            stdout=subprocess.DEVNULL,
            preexec_fn=lambda: os.sched_setaffinity(0, cores),
        )
        try:
            ended = wait_for_first_episode(process, recording)
            recording.names = node_names(process.pid)
            found = recording.read()
        finally:
            stop(process)
        main = recording.names.get(process.pid, str(process.pid))
        return evaluated(found, main, began, ended)


def wait_for_first_episode(process: subprocess.Popen[Any], recording: Recording) -> float:
    """Return when the first episode ended.

    Raises:
        SystemExit: The process ended instead, or takes too long.
    """
    deadline = time.monotonic() + LONGEST
    while (ended := recording.first_episode()) is None:
        if process.poll() is not None:
            raise SystemExit(f"the run ended with {process.returncode} before its first episode")
        if time.monotonic() > deadline:
            raise SystemExit(f"no episode ended within {LONGEST:.0f} s")
        time.sleep(0.05)  # no event tells that another process has written to a file
    return ended


def node_names(pid: int) -> dict[int, str]:
    """Return the names of a process and its children by process id; children carry the names of their nodes."""
    names = {pid: "orchestrator"}
    for child in children_of(pid):
        words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
        names[child] = next((w.split(":=")[1] for w in words if w.startswith("__node:=")), "?")
    return names


def stop(process: subprocess.Popen[Any]) -> None:
    """Stop a run and wait until it has ended."""
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def evaluated(
    found: dict[str, dict[str, dict[str, Any]]], main: str, began: float, ended: float
) -> Started:
    """Return what the marks of a start say."""
    children = {
        name: {
            part: mark[edge] - began
            for part, choice, edge in PARTS_OF_CHILDREN
            for mark in [marks[name] for name in choice if name in marks][:1]
            if mark[edge] <= ended
        }
        for name, marks in sorted(found.items())
        if name != main
    }
    core = {
        name: marks["GraphNode.start_heartbeat"]["core"]
        for name, marks in sorted(found.items())
        if "GraphNode.start_heartbeat" in marks
    }
    cvt = found[main].get("cvt_centroids", {"began": 0.0, "ended": 0.0})
    parts = main_line(found, main, began, ended) if children else {}
    return Started(ended - began, parts, children, core, cvt["ended"] - cvt["began"])


def main_line(
    found: dict[str, dict[str, dict[str, Any]]], main: str, began: float, ended: float
) -> dict[str, float]:
    """Return the seconds of the parts that follow one another."""
    marks = found[main]
    ends = {part: marks[mark][edge] for part, mark, edge in MAIN_LINE}
    heartbeats = [
        child["GraphNode.start_heartbeat"]["ended"]
        for child in found.values()
        if "GraphNode.start_heartbeat" in child
    ]
    ends["start of the children"] = max(heartbeats)
    ends["hearing from all, services found"] = marks["GenerationLoop.run begins"]["began"]
    makers = [child["make_offspring"] for child in found.values() if "make_offspring" in child]
    ends["first controllers"] = min(made["ended"] for made in makers)
    begun = [c["rollout begins"]["began"] for c in found.values() if "rollout begins" in c]
    ends["request to an evaluator"] = min(begun)
    ends["first episode"] = ended
    parts, before = {}, began
    for part, at in ends.items():
        after = max(before, min(at, ended))
        parts[part] = after - before
        before = after
    return parts


def shares(starts: list[Started]) -> dict[str, float]:
    """Return the median share of each part of the main line."""
    return {
        part: round(statistics.median(s.parts[part] / s.seconds for s in starts), 3)
        for part in starts[0].parts
    }


def show(name: str, starts: list[Started]) -> None:
    """Print where the time of some starts of the graph went."""
    total = statistics.median(s.seconds for s in starts)
    print(f"\n{name}: {total:.1f} s from the command to the end of the first episode; of these")
    for part, share in shares(starts).items():
        print(f"  {part:34} {100 * share:5.1f} %")
    cvt = statistics.median(s.cvt / s.seconds for s in starts)
    print(f"  (centroids of the archive, wherever they are made: {100 * cvt:.1f} %)")
    columns = [part for part, _, _ in PARTS_OF_CHILDREN]
    print(f"  {'ended at':17}" + "".join(f"{column:>11}" for column in columns) + "  core time")
    for node in starts[0].children:
        there = [s for s in starts if node in s.children]
        cells = []
        for column in columns:
            at = [s.children[node][column] / s.seconds for s in there if column in s.children[node]]
            cells.append(f"{100 * statistics.median(at):9.1f} %" if at else f"{'-':>11}")
        core = statistics.median(s.core.get(node, 0.0) for s in there)
        print(f"  {node:17}" + "".join(cells) + f"  {core:.2f} s", flush=True)


def ratios(a: list[Started], b: list[Started]) -> list[float]:
    """Return the times of one kind of start relative to those of another, round by round."""
    return [x.seconds / y.seconds for x, y in zip(a, b, strict=True)]


def measure(
    kinds: dict[str, Callable[[], Started]], rounds: int
) -> dict[str, dict[str, list[Started]]]:
    """Measure all kinds of starts in turn, `rounds` times in each order; return them by order and kind."""
    orders = {"in this order": list(kinds), "in the reverse order": list(reversed(kinds))}
    out: dict[str, dict[str, list[Started]]] = {
        order: {kind: [] for kind in kinds} for order in orders
    }
    for _ in range(rounds):
        for order, names in orders.items():
            for kind in names:
                out[order][kind].append(kinds[kind]())
                seconds = out[order][kind][-1].seconds
                print(f"{kind}, {order}: {seconds:.2f} s", flush=True)
    return out


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="rounds in each order")
    parser.add_argument("--older", type=Path, help="a clone of another revision, set up")
    parser.add_argument("--cores", type=int, default=0, help="cores to use; all by default")
    arguments = parser.parse_args()
    there = sorted(os.sched_getaffinity(0))
    cores = set(there[: arguments.cores or len(there)])
    kinds: dict[str, Callable[[], Started]] = {
        "one process": lambda: start(HERE.parent, graph=False, cores=cores),
        "graph": lambda: start(HERE.parent, graph=True, cores=cores),
    }
    if arguments.older:
        older = arguments.older.resolve()
        if not (older / ".venv/setup.bash").exists():
            sys.exit(f"'{older}' has no .venv; expected a clone after 'make setup'")
        kinds["older graph"] = lambda: start(older, graph=True, cores=cores)
    figures: dict[str, Any] = {"cores": len(cores)}
    for order, by_kind in measure(kinds, arguments.rounds).items():
        found: dict[str, Any] = {
            "seconds": spread([s.seconds for s in by_kind["graph"]]),
            "graph / one process": spread(ratios(by_kind["graph"], by_kind["one process"])),
            "share": shares(by_kind["graph"]),
        }
        show(f"graph, {order}", by_kind["graph"])
        if arguments.older:
            show(f"older graph, {order}", by_kind["older graph"])
            found["graph / older graph"] = spread(ratios(by_kind["graph"], by_kind["older graph"]))
        figures[order] = found
    print(json.dumps({"bench": "startup", "figures": figures}))


if __name__ == "__main__":
    main()
