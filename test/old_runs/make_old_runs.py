"""Makes runs of a revision that later versions must be able to resume; README.md says when and how.

Each is a folder as the orchestrator leaves it, without logs, locks and files needed only after a crash. `runs.json`
next to them says how they were started, how they are resumed, and with what result.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "graph"))

from contents import machine_digest, result_digest
from domain_coordinator import domain_id
from graph import Graph

import pga_me_ros
from pga_me_ros.reevaluate.__main__ import main as reevaluate

HERE = Path(__file__).resolve().parent

SMALL = {"seed": 1, "controller_hidden": [6, 6], "evaluators": 1, "serve": False}
CVT = {"task": "qd_hopper", "cells": 40, "cvt_samples": 2000}
CRITICS = {
    "critic_hidden": [8, 8],
    "n_grad": 2,
    "n_crit": 11,
    "transition_batch": 16,
    "replay_size": 300,
}
PGA = {"algorithm": "pga_map_elites", "random_init": 14, "batch_size": 7, "n_evo": 3}
ES = {"algorithm": "map_elites_es", "es_samples": 6, "es_steps": 2, "es_neighbors": 3}
GRID = {"task": "qd_walker", "archive": "grid"}
MAP_ELITES = {"algorithm": "map_elites", "random_init": 14, "batch_size": 7}
QD_RL = {"algorithm": "qd_rl", "random_init": 10, "batch_size": 5, "novelty_neighbors": 3}

RUNS: dict[str, dict[str, Any]] = {
    "pga_map_elites": {**SMALL, **CVT, **CRITICS, **PGA},
    "qd_rl": {**SMALL, **CVT, **CRITICS, **QD_RL, "state_archive_size": 100},
    "map_elites_es": {**SMALL, **CVT, **ES},
    "map_elites_grid": {**SMALL, **GRID, **MAP_ELITES},
}
GENERATIONS, RESUMED_GENERATIONS = 5, 7

REPERTOIRE_ALONE = ("map_elites_grid",)
"""Runs that need only the repertoire file to resume, because they learn nothing."""

REEVALUATED = ("pga_map_elites",)


def batch_size(parameters: dict[str, Any]) -> int:
    """Return the number of evaluations per generation."""
    return parameters.get("batch_size") or parameters["es_samples"] + 1


def carry_out(run_dir: Path, parameters: dict[str, Any]) -> None:
    """Carry out a run, or resume the one that a folder holds.

    Raises:
        SystemExit: The run failed.
    """
    with domain_id() as domain:
        graph = Graph(domain, run_dir.parent)
        try:
            run = graph.start("orchestrator", {**parameters, "run_dir": run_dir.name})
            if run.wait():
                raise SystemExit(run.output)
        finally:
            graph.kill()


def strip(run: Path) -> None:
    """Remove what the next start creates again, and the name of the folder in which the run was made."""
    shutil.rmtree(run / "logs")
    for file in (run / "run.lock", run / "repertoire.db.lock", *sorted(run.glob("*.ckpt"))[:-1]):
        file.unlink()
    if run.name in REPERTOIRE_ALONE:
        for file in sorted(run.rglob("*"), reverse=True):
            if file.name != "repertoire.db":
                file.rmdir() if file.is_dir() else file.unlink()
    for file in run.glob("parameters/*.yaml"):
        file.write_text(file.read_text().replace(f"{run.parent}/", ""))


def make(out: Path) -> None:
    """Make all runs and `runs.json`."""
    listed: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        for name, parameters in RUNS.items():
            made, copied = Path(first) / name, Path(second) / name
            budgets = [n * batch_size(parameters) for n in (GENERATIONS, RESUMED_GENERATIONS)]
            carry_out(made, {**parameters, "evaluations": budgets[0]})
            strip(made)
            shutil.copytree(made, out / name)
            shutil.copytree(made, copied)
            carry_out(copied, {**parameters, "evaluations": budgets[1]})
            if name in REEVALUATED:
                reevaluate([str(made), "--repeats", "2", "--best", "3"])
                shutil.copy(made / "reevaluations.npz", out / name)
            listed[name] = {
                "parameters": parameters,
                "evaluations": budgets[0],
                "resumed_evaluations": budgets[1],
                "digest": result_digest(made),
                "resumed_digest": result_digest(copied),
            }
    content = {"machine_digest": machine_digest(), "runs": listed}
    (out / "runs.json").write_text(json.dumps(content, indent=2) + "\n")


def main() -> None:
    """Make the runs of the package that Python imports."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("revision", help="name of the new folder: the revision that is imported")
    revision = parser.parse_args().revision
    (HERE / revision).mkdir()
    print(f"runs by {Path(pga_me_ros.__file__).parent}")
    make(HERE / revision)


if __name__ == "__main__":
    main()
