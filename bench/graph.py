"""The whole graph with two evaluators against `core.search` in one process, for the same generations.

Run: `.venv/bin/python bench/graph.py [--rounds 2] [--part early|late]`; the last line is JSON. Both do the same
generations of the same seed in turn (A B A B ...), and must end with the same repertoire, bit for bit. `early` is
QDWalker with its short first episodes, `late` QDHalfCheetah with 1000 steps in each.

The share of time is core time: what each process used of the cores while the compared generations were done. What no
process used is waiting.
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
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from _measure import spread
from _run_times import committed

from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage import Repertoire
from pga_me_ros.tasks.registry import load_task

CORES = 2
TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Part:
    """Generations that are compared: those after the first `skipped`."""

    task: str
    random_init: int
    generations: int
    skipped: int


PARTS = {
    "early": Part("qd_walker", random_init=500, generations=15, skipped=6),
    "late": Part("qd_half_cheetah", random_init=100, generations=4, skipped=2),
}


@dataclass(frozen=True)
class Measured:
    """Seconds per compared generation, core seconds per kind of process meanwhile, and the result."""

    seconds: list[float]
    cpu: dict[str, float]
    digest: str


def settings_of(part: Part, seed: int) -> Settings:
    """Return the settings of a part's run; Table 1 but for the number of random controllers."""
    return Settings(
        task=part.task,
        seed=seed,
        random_init=part.random_init,
        evaluations=part.generations * 100,
    )


def run_search(part: Part, seed: int) -> Measured:
    """Do the generations in this process."""
    task = load_task(part.task)()
    search = Search(task.spec, settings_of(part, seed))
    seconds = []
    for _ in range(part.generations):
        start = time.perf_counter()
        search.run_generation(task)
        seconds.append(time.perf_counter() - start)
    task.close()
    return Measured(seconds[part.skipped :], {}, search.archive.digest())


def run_graph(part: Part, seed: int) -> Measured:
    """Do the generations with the graph."""
    settings = settings_of(part, seed)
    with tempfile.TemporaryDirectory() as folder:
        values = {
            "task": part.task,
            "seed": seed,
            "random_init": part.random_init,
            "evaluations": settings.evaluations,
            "evaluators": CORES,
            "serve": "false",
            "run_dir": folder,
        }
        command = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator", "--ros-args"]
        for name, value in values.items():
            command += ["-p", f"{name}:={value}"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            file = Path(folder) / "repertoire.db"
            wait_for_generation(process, file, part.skipped - 1)
            before = core_seconds(process.pid)
            wait_for_generation(process, file, part.generations - 1)
            after = core_seconds(process.pid)
            process.wait()
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait()
        with Repertoire.open(file, read_only=True) as repertoire:
            digest = repertoire.result_digest()
        times = committed(file)
    seconds = [b - a for a, b in pairwise(times)][part.skipped - 1 :]
    return Measured(seconds, {k: after[k] - before.get(k, 0.0) for k in after}, digest)


def wait_for_generation(process: subprocess.Popen[bytes], file: Path, generation: int) -> None:
    """Wait until a generation is committed."""
    while len(committed(file)) <= generation:
        if process.poll() not in (None, 0):
            raise SystemExit(f"the orchestrator ended with {process.returncode}")
        time.sleep(0.02)


def core_seconds(orchestrator: int) -> dict[str, float]:
    """Return the core seconds that each kind of process has used."""
    out: dict[str, float] = {}
    for pid in [orchestrator, *children_of(orchestrator)]:
        try:
            stat = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
            arguments = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
        kind = next(a for a in arguments if a.startswith("pga_me_ros.nodes.")).split(".")[-1]
        out[kind] = out.get(kind, 0.0) + (int(stat[11]) + int(stat[12])) / TICKS
    return out


def children_of(pid: int) -> list[int]:
    """Return the process ids of a process's children."""
    return [
        int(child)
        for task in Path(f"/proc/{pid}/task").iterdir()
        for child in (task / "children").read_text().split()
    ]


def measure(name: str, part: Part, rounds: int) -> dict[str, object]:
    """Compare one part; print and return its figures."""
    ratios, shares = [], []
    for seed in range(1, rounds + 1):
        alone, graph = run_search(part, seed), run_graph(part, seed)
        if alone.digest != graph.digest:
            raise SystemExit(
                f"{name}, seed {seed}: the graph's repertoire differs from the search's"
            )
        ratios.append(sum(graph.seconds) / sum(alone.seconds))
        available = CORES * sum(graph.seconds)
        share = {kind: used / available for kind, used in graph.cpu.items()}
        share["waiting"] = 1.0 - sum(share.values())
        shares.append(share)
        print(
            f"{name} seed {seed}: one process {sum(alone.seconds):.1f} s, graph {sum(graph.seconds):.1f} s"
        )
    figures: dict[str, object] = {
        "time_of_one_process": spread(ratios),
        "share": {
            kind: round(statistics.median(s.get(kind, 0.0) for s in shares), 3)
            for kind in shares[0]
        },
    }
    print(f"{name}: {figures}")
    return figures


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--part", choices=PARTS, help="one part only")
    arguments = parser.parse_args()
    chosen = [arguments.part] if arguments.part else list(PARTS)
    figures = {name: measure(name, PARTS[name], arguments.rounds) for name in chosen}
    print(json.dumps({"bench": "graph", "figures": figures}))


if __name__ == "__main__":
    main()
