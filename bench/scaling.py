"""Evaluations per second with more and more evaluators, relative to one.

Run: `.venv/bin/python bench/scaling.py [--part real|sleeping]`; the last line is JSON. `real` simulates QDHalfCheetah,
whose physics needs a core per evaluator. `sleeping` has evaluators that sleep for as long as physics would take, so
that only the graph limits how many of them are useful.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from _processes import start_run
from _run_times import committed

GENERATIONS = 4
"""Generations per run, all by genetic variation; the first does not count."""


@dataclass(frozen=True)
class Part:
    """A task, and the numbers of evaluators to run it with."""

    task: str
    batch_size: int
    evaluators: tuple[int, ...]


PARTS = {
    "real": Part("qd_half_cheetah", 40, (1, 2, 4, 8)),
    "sleeping": Part("_sleeping:SleepingTask", 256, (1, 2, 4, 8, 16, 32)),
}


def rate(part: Part, evaluators: int) -> float:
    """Return the evaluations per second of a run without its start and first generation."""
    with tempfile.TemporaryDirectory() as folder:
        batch = part.batch_size if evaluators > 1 else max(8, part.batch_size // 8)
        values = {
            "task": part.task,
            "batch_size": batch,
            "random_init": batch,
            "n_evo": batch,
            "controller_hidden": "[32, 32]",
            "evaluations": GENERATIONS * batch,
            "evaluators": evaluators,
            "min_evaluators": evaluators,
            "serve": "false",
            "reevaluations": 0,
        }
        process = start_run(folder, values)
        if process.wait():
            raise SystemExit(f"the orchestrator ended with {process.returncode}")
        seconds = [b - a for a, b in pairwise(committed(Path(folder) / "repertoire.db"))]
    return batch / statistics.median(seconds)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=PARTS, help="one part only")
    arguments = parser.parse_args()
    figures: dict[str, dict[str, float]] = {}
    for name in [arguments.part] if arguments.part else list(PARTS):
        part = PARTS[name]
        one = rate(part, part.evaluators[0])
        figures[name] = {"1": 1.0}
        for evaluators in part.evaluators[1:]:
            figures[name][str(evaluators)] = round(rate(part, evaluators) / one, 2)
            print(
                f"{name}: {evaluators} evaluators do {figures[name][str(evaluators)]} times as much"
            )
    print(json.dumps({"bench": "scaling", "figures": figures}))


if __name__ == "__main__":
    main()
