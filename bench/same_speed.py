"""Speed of this checkout against that of an older one, measured in turn: for changes that must not cost any.

Run: `.venv/bin/python bench/same_speed.py OLDER [--rounds 31] [--graph-rounds 4]`; the last line is JSON. OLDER is a
clone of the older revision in which `make setup` was done: each tree runs with its own environment, since messages and
pins may differ. Every figure is old time / new time of the same work (old new new old ...), the median over rounds:
1 is as fast as before, 0.97 is 3 % slower.

Episodes, critic training and PG variation run in one process per tree, which waits while the other one works. The
graph does the early generations of QDWalker with two evaluators, as in `bench/graph.py`, one tree after the other.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import IO

from _measure import spread
from _processes import HERE, python_of, start_run, wait_for_generation
from _run_times import committed

OURS = HERE.parent

GENERATIONS, SKIPPED = 15, 6
"""Generations of the graph's run, and how many at its start are not timed."""


class Worker:
    """A process that does work with the code of a source tree."""

    def __init__(self, tree: Path) -> None:
        """Start it and wait until it has prepared its work.

        Raises:
            SystemExit: It ended instead, or runs the code of another tree.
        """
        self._process = python_of(
            tree, str(HERE / "_speeds.py"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdin
        assert self._process.stdout
        self._in: IO[str] = self._process.stdin
        self._out: IO[str] = self._process.stdout
        code = Path(self._read())
        if tree not in code.parents:
            raise SystemExit(f"the environment of '{tree}' runs the code of '{code.parent}'")
        self.names = list(iter(self._read, "ready"))

    def seconds(self, name: str) -> float:
        """Do some work and return the time that it took."""
        print(name, file=self._in, flush=True)
        return float(self._read())

    def close(self) -> None:
        """End the process."""
        self._in.close()
        self._process.wait()

    def _read(self) -> str:
        line = self._out.readline()
        if not line:
            raise SystemExit("a process that does the work ended; its error is above")
        return line.strip()


def work_ratios(older: Path, rounds: int) -> dict[str, list[float]]:
    """Return old / new time of each kind of work, by round."""
    old, new = Worker(older), Worker(OURS)
    out: dict[str, list[float]] = {name: [] for name in new.names}
    for i in range(rounds):
        order = (old, new) if i % 2 else (new, old)
        for name, ratios in out.items():
            times = {worker: worker.seconds(name) for worker in order}
            ratios.append(times[old] / times[new])
    old.close()
    new.close()
    return out


def graph_seconds(tree: Path, seed: int) -> float:
    """Return the time that a run of a tree takes for its early generations."""
    values = {
        "task": "qd_walker",
        "seed": seed,
        "evaluations": GENERATIONS * 100,
        "evaluators": 2,
        "serve": "false",
    }
    with tempfile.TemporaryDirectory() as folder:
        process = start_run(folder, values, tree)
        file = Path(folder) / "repertoire.db"
        try:
            wait_for_generation(process, file, GENERATIONS - 1)
            process.wait()
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait()
        times = committed(file)
    return sum(b - a for a, b in list(pairwise(times))[SKIPPED - 1 :])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("older", type=Path, help="a clone of the older revision, set up")
    parser.add_argument("--rounds", type=int, default=31)
    parser.add_argument("--graph-rounds", type=int, default=4)
    arguments = parser.parse_args()
    older = arguments.older.resolve()
    if not (older / ".venv/setup.bash").exists():
        sys.exit(
            f"'{older}' has no .venv; expected a clone of the older revision after 'make setup'"
        )
    ratios = work_ratios(older, arguments.rounds) if arguments.rounds else {}
    for seed in range(arguments.graph_rounds):
        order = (older, OURS) if seed % 2 else (OURS, older)
        times = {tree: graph_seconds(tree, seed) for tree in order}
        print(f"graph: old {times[older]:.1f} s, new {times[OURS]:.1f} s", flush=True)
        ratios.setdefault("graph, early", []).append(times[older] / times[OURS])
    figures = {name: spread(values) for name, values in ratios.items() if values}
    for name, values in figures.items():
        print(f"{name:24} {values['median']:.3f}  ({values['min']:.3f} to {values['max']:.3f})")
    print(json.dumps({"bench": "same_speed", "figures": figures}))


if __name__ == "__main__":
    main()
