"""The whole graph with two evaluators compared with `core.search` in one process, for the same generations.

Run: `.venv/bin/python bench/graph.py [--rounds 2] [--part early|late|dcrl]`; the last line is JSON. Both do the same
generations of the same seed in turn (A B A B ...), and must end with the same repertoire, bit for bit. `early` is
QDWalker with its short first episodes, `late` QDHalfCheetah with 1000 steps in each, `dcrl` the same with
DCRL-MAP-Elites.

`of_need` is the time of the graph's generations in shares of what physics, critic training and PG variation alone need
on all cores, if they are divided evenly and each takes as long as next to another process.

The shares are those of the core time of the graph's generations. The time of episodes is measured in the graph, and
divided between physics and the Python around it in the proportion measured in one process, where calls are timed.
Critic training, PG variation, the archive and the rest of the work (GA offspring, building controllers, keeping
experience) count as long as they take in one process while a second one does the same on the other core, because two
busy cores share caches and memory. How much slower each is than one alone is printed, too: no program can bring a
generation below half of that. What training and PG variation take beyond that in the graph is "crowding": threads of a
training wait for each other, and more threads than cores take turns. Everything else that its processes use is
"messages": serializing, copying, storing, waking up. Idle time of a core is "waiting"; the rest went to other processes
of the machine, including this one and the kernel's.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import statistics
import tempfile
import time
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib as mpl
import numpy as np
import pybullet
from _measure import spread
from _processes import (
    core_seconds,
    idle_seconds,
    listening_seconds,
    running,
    wait_for_generation,
)
from _run_times import committed
from _stopwatch import Stopwatch
from _timed_tasks import EPISODES, FOLDER, PG_VARIATION, seconds_of

from pga_me_ros.core import search as core_search
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.variation import make_offspring
from pga_me_ros.tasks.registry import load_task

CORES = 2

SIMULATION = ("physics", "Python around physics")
"""Parts of an episode."""

NEEDED = (*SIMULATION, "critic", "PG variation")
"""What a generation cannot do without."""


@dataclass(frozen=True)
class Part:
    """The generations that are compared: those after the first `skipped`.

    One more follows them, so that the graph's processes are still there when their time is read.
    """

    task: str
    random_init: int
    generations: int
    skipped: int
    algorithm: str = "pga_map_elites"
    batch_size: int = 100


PARTS = {
    "early": Part("_timed_tasks:TimedWalker", random_init=500, generations=15, skipped=6),
    "late": Part("_timed_tasks:TimedHalfCheetah", random_init=100, generations=4, skipped=2),
    "dcrl": Part(
        "_timed_tasks:TimedHalfCheetah",
        random_init=256,
        generations=3,
        skipped=1,
        algorithm="dcrl_map_elites",
        batch_size=256,
    ),
}


@dataclass(frozen=True)
class Measured:
    """What the compared generations cost, and their result.

    Attributes:
        seconds: Time of each.
        cores: Core seconds of all: in one process by part of the work, in the graph by kind of process.
        digest: Digest of the repertoire.
        listening: Core seconds of the threads of each kind of process that send and receive.
        episodes: Core seconds of the evaluators' episodes.
        pg_variation: Core seconds of PG variation.
        idle: Idle seconds, summed over the cores.
    """

    seconds: list[float]
    cores: dict[str, float]
    digest: str
    listening: dict[str, float] = field(default_factory=dict)
    episodes: float = 0.0
    pg_variation: float = 0.0
    idle: float = 0.0


def settings_of(part: Part, seed: int) -> Settings:
    """Return the settings of a part's run: the algorithm's own except for the number of random controllers."""
    return Settings(
        task=part.task,
        seed=seed,
        algorithm=part.algorithm,
        random_init=part.random_init,
        evaluations=(part.generations + 1) * part.batch_size,
    )


def run_search(part: Part, seed: int) -> Measured:
    """Carry out the generations in this process."""
    task = load_task(part.task)()
    search = Search(task.spec, settings_of(part, seed))
    watch = Stopwatch()
    seconds = []
    with watch.timing(
        (pybullet, "stepSimulation", "physics"),
        (core_search, "rollout", "Python around physics"),
        (search.learner, "train", "critic"),
        (make_offspring, "pg_variation", "PG variation"),
        (search.archive, "sample_parents", "archive"),
        (search.archive, "add", "archive"),
    ):
        for generation in range(part.generations):
            if generation == part.skipped:
                watch.clear()
            start = time.perf_counter()
            search.run_generation(task)
            seconds.append(time.perf_counter() - start)
    search.run_generation(task)
    task.close()
    seconds = seconds[part.skipped :]
    other = sum(seconds) - sum(watch.seconds.values())
    return Measured(seconds, {**watch.seconds, "other work": other}, search.archive.digest())


def run_search_beside_another(part: Part, seed: int) -> Measured:
    """Carry out the generations in this process while another one does the same."""
    longer = replace(part, generations=10 * part.generations)
    other = multiprocessing.get_context("spawn").Process(
        target=run_search, args=(longer, seed), daemon=True
    )
    other.start()
    try:
        return run_search(part, seed)
    finally:
        other.kill()
        other.join()


def run_graph(part: Part, seed: int) -> Measured:
    """Carry out the generations with the graph."""
    settings = settings_of(part, seed)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as notes:
        values = {
            "task": part.task,
            "seed": seed,
            "algorithm": part.algorithm,
            "random_init": part.random_init,
            "evaluations": settings.evaluations,
            "evaluators": CORES,
            "serve": "false",
            "reevaluations": 0,
        }
        file = Path(folder) / "repertoire.db"
        with running(folder, values, **{FOLDER: notes}) as process:
            wait_for_generation(process, file, part.skipped - 1)
            before = core_seconds(process.pid), listening_seconds(process.pid)
            work = {kind: -seconds_of(kind, notes) for kind in (EPISODES, PG_VARIATION)}
            idle = -idle_seconds()
            wait_for_generation(process, file, part.generations - 1)
            after = core_seconds(process.pid), listening_seconds(process.pid)
            work = {kind: seconds + seconds_of(kind, notes) for kind, seconds in work.items()}
            idle += idle_seconds()
            process.wait()
        with Repertoire.open(file, read_only=True) as repertoire:
            digest = repertoire.result_digest()
        times = committed(file)
    seconds = [b - a for a, b in pairwise(times)][part.skipped - 1 : part.generations - 1]
    cores, listening = (
        {kind: b[kind] - a.get(kind, 0.0) for kind in b} for a, b in zip(before, after, strict=True)
    )
    helpers = cores["variation"] - listening["variation"]
    pg_variation = work[PG_VARIATION] + helpers
    return Measured(seconds, cores, digest, listening, work[EPISODES], pg_variation, idle)


def shares(busy: Measured, graph: Measured) -> dict[str, float]:
    """Divide the core time of the graph's generations between the parts of the work."""
    available = CORES * sum(graph.seconds)
    used = sum(graph.cores.values())
    training = graph.cores["critic_trainer"] - graph.listening["critic_trainer"]
    parts = dict(busy.cores)
    simulated = [parts[part] for part in SIMULATION]
    for part in SIMULATION:
        parts[part] *= graph.episodes / sum(simulated)
    parts["crowding"] = training - parts["critic"] + graph.pg_variation - parts["PG variation"]
    parts["messages"] = used - sum(parts.values())
    parts["waiting"] = graph.idle
    parts["other processes"] = available - used - graph.idle
    return {part: seconds / available for part, seconds in parts.items()}


def of_need(busy: Measured, graph: Measured) -> float:
    """Return the time of the graph's generations in shares of what their work needs on all cores."""
    return CORES * sum(graph.seconds) / sum(busy.cores[part] for part in NEEDED)


def measure(name: str, part: Part, rounds: int) -> dict[str, Any]:
    """Compare one part; print and return its figures."""
    ratios, slower, needs, divided, times = [], [], [], [], []
    for seed in range(1, rounds + 1):
        alone, graph = run_search(part, seed), run_graph(part, seed)
        busy = run_search_beside_another(part, seed)
        if alone.digest != graph.digest:
            raise SystemExit(
                f"{name}, seed {seed}: the graph's repertoire differs from the search's"
            )
        ratios.append(sum(graph.seconds) / sum(alone.seconds))
        slower.append(sum(busy.seconds) / sum(alone.seconds))
        needs.append(of_need(busy, graph))
        divided.append(shares(busy, graph))
        times.append(statistics.mean(graph.seconds))
        print(
            f"{name} seed {seed}: one process {sum(alone.seconds):.1f} s, next to another "
            f"{sum(busy.seconds):.1f} s, graph {sum(graph.seconds):.1f} s; "
            f"core seconds by process {rounded(graph.cores)}, of threads that receive "
            f"{rounded(graph.listening)}, of episodes {graph.episodes:.2f}, of PG variation {graph.pg_variation:.2f}",
            flush=True,
        )
    share = {k: round(statistics.median(d[k] for d in divided), 3) for k in divided[0]}
    figures: dict[str, Any] = {
        "time_of_one_process": spread(ratios),
        "one_process_beside_another": spread(slower),
        "of_need": spread(needs),
        "share": share,
        "core_seconds_per_generation": {
            k: round(v * CORES * statistics.median(times), 3) for k, v in share.items()
        },
        "overhead": round(share["messages"] + share["waiting"] + share["archive"], 3),
    }
    print(f"{name}: {figures}", flush=True)
    return figures


def rounded(seconds: dict[str, float]) -> dict[str, float]:
    """Return core seconds, rounded for printing."""
    return {kind: round(value, 2) for kind, value in seconds.items()}


def draw(file: Path, figures: dict[str, dict[str, Any]]) -> None:
    """Draw how a generation's core time is used, one bar per compared part of a run."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    parts = list(next(iter(figures.values()))["share"])
    colors = plt.get_cmap("cividis")(np.linspace(0, 1, len(parts)))
    figure, axes = plt.subplots(figsize=(8, 1.2 + 0.7 * len(figures)), layout="constrained")
    left = np.zeros(len(figures))
    labels = [f"{name}\n{load_task(PARTS[name].task).spec.name}" for name in figures]
    for part, color in zip(parts, colors, strict=True):
        widths = [100 * max(0.0, figure["share"][part]) for figure in figures.values()]
        axes.barh(labels, widths, left=left, color=color, label=part)
        left += widths
    axes.set(xlabel=f"share of the time of {CORES} cores [%]", xlim=(0, 100))
    axes.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    figure.savefig(file, dpi=120)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--part", choices=PARTS, help="one part only")
    parser.add_argument("--picture", type=Path, help="PNG to draw the shares into")
    arguments = parser.parse_args()
    if os.cpu_count() != CORES:
        raise SystemExit(
            f"This bench divides the time of {CORES} cores; this machine has {os.cpu_count()}."
        )
    chosen = [arguments.part] if arguments.part else list(PARTS)
    figures = {name: measure(name, PARTS[name], arguments.rounds) for name in chosen}
    if arguments.picture:
        draw(arguments.picture, figures)
    print(json.dumps({"bench": "graph", "figures": figures}))


if __name__ == "__main__":
    main()
