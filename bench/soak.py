"""Memory of the whole graph with two evaluators over many generations, with the replay buffer full.

Run: `.venv/bin/python bench/soak.py [--generations 1000] [--out FOLDER] [-p name:=value ...]`; the last line is JSON.
Memory is proportional set size, so that pages shared by processes count once. Networks, archive and replay buffer are
those of Table 1 on QDWalker. Critics and PG offspring take fewer steps per generation unless -p says otherwise, which
changes the time but not the memory. The growth is the slope of the line through the samples after the buffer was full.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from _processes import kinds_of_processes, start_run
from _run_times import committed, steps_of_generations

from pga_me_ros.core.settings import Settings

PERIOD = 5.0
"""Seconds between two samples."""

MB = 1e6


@dataclass(frozen=True)
class Sample:
    """Memory at one moment.

    Attributes:
        generation: Number of committed generations.
        transitions: Number of transitions in the replay buffer.
        memory: Proportional set size per kind of process, megabytes.
    """

    generation: int
    transitions: int
    memory: dict[str, float]

    @property
    def total(self) -> float:
        """Memory of the graph, megabytes."""
        return sum(self.memory.values())


def proportional_set_size(pid: int) -> float:
    """Return the memory of a process, megabytes; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) * 1024 / MB


def sampled(process: subprocess.Popen[bytes], file: Path) -> Iterator[Sample]:
    """Yield a sample per period during a run."""
    while process.poll() is None:
        memory: dict[str, float] = {}
        for pid, kind in kinds_of_processes(process.pid):
            memory[kind] = memory.get(kind, 0.0) + proportional_set_size(pid)
        transitions = min(sum(steps_of_generations(file)), Settings.replay_size)
        if memory:
            yield Sample(len(committed(file)), transitions, memory)
        time.sleep(PERIOD)
    if process.returncode:
        raise SystemExit(f"the orchestrator ended with {process.returncode}")


def growth(samples: list[Sample]) -> float:
    """Return the slope of the line through samples, megabytes per 100 generations."""
    slope, _ = np.polyfit([s.generation for s in samples], [s.total for s in samples], 1)
    return float(slope) * 100


def write_table(file: Path, samples: list[Sample]) -> None:
    """Write the samples as CSV."""
    kinds = sorted({kind for sample in samples for kind in sample.memory})
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["generation", "transitions", *(f"{kind}_MB" for kind in kinds)])
        for s in samples:
            memory = [round(s.memory.get(kind, 0.0), 1) for kind in kinds]
            writer.writerow([s.generation, s.transitions, *memory])


def draw(file: Path, samples: list[Sample], full: int) -> None:
    """Draw memory by kind of process over generations."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    kinds = sorted({kind for sample in samples for kind in sample.memory})
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    x = [s.generation for s in samples]
    y = [[s.memory.get(kind, 0.0) for s in samples] for kind in kinds]
    axes.stackplot(
        x, y, labels=kinds, colors=plt.get_cmap("cividis")(np.linspace(0, 1, len(kinds)))
    )
    axes.axvline(full, color="black", linestyle=":", label="replay buffer full")
    axes.set(xlabel="generation", ylabel="memory (PSS) [MB]", xlim=(0, x[-1]))
    axes.legend(loc="lower right")
    figure.savefig(file, dpi=120)


def main() -> None:
    """Run, sample, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=Path())
    parser.add_argument("-p", action="append", default=["n_crit:=30", "n_grad:=2"])
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    values = {"evaluations": arguments.generations * 100, "evaluators": 2, "serve": "false"}
    values["reevaluations"] = 0
    values |= dict(text.split(":=", 1) for text in arguments.p)
    with tempfile.TemporaryDirectory() as folder:
        process = start_run(folder, values)
        try:
            samples = list(sampled(process, Path(folder) / "repertoire.db"))
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.wait()
    write_table(arguments.out / "soak.csv", samples)
    late = [s for s in samples if s.transitions == Settings.replay_size]
    figures: dict[str, float] = {
        "generations": samples[-1].generation,
        "transitions": samples[-1].transitions,
        "peak_MB": round(max(s.total for s in samples), 1),
    }
    if len(late) > 2:
        figures["generation_when_full"] = late[0].generation
        figures["growth_since_full_MB_per_100_generations"] = round(growth(late), 3)
    draw(
        arguments.out / "soak.png", samples, late[0].generation if late else samples[-1].generation
    )
    print(json.dumps({"bench": "soak", "figures": figures}))


if __name__ == "__main__":
    main()
