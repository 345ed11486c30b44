"""A tiny experiment with real runs: stopped and resumed, with a run that cannot start."""

from __future__ import annotations

import re
import signal
import sys
from pathlib import Path

import pytest
from graph import TINY, Graph, Started
from processes import wait_for_no_children
from reference import NOT_SETTINGS, run_digest, search_digest

from pga_me_ros.core.storage.reevaluations import REPEATS, Reevaluations
from pga_me_ros.core.storage.repertoire import Repertoire

SETTINGS = {name: value for name, value in TINY.items() if name not in NOT_SETTINGS}
ALGORITHMS = {"half": 5, "ga": 10}
"""Systems of the experiment by their n_evo: 10 of 10 offspring means only genetic variation."""

TASK = "qd_hopper"
BUDGET = 30
PATIENCE = 240.0
"""Maximum seconds of a run on a busy machine."""


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Return an experiment file whose third system cannot start."""
    shared = {n: v for n, v in SETTINGS.items() if n not in ("n_evo", "evaluations")}
    systems = {name: {"n_evo": n_evo} for name, n_evo in ALGORITHMS.items()}
    systems["lost"] = {"start_from": "nowhere", "n_evo": 5}
    file = tmp_path / "tiny.yaml"
    file.write_text(
        f"systems: {systems}\ntasks: [{TASK}]\nseeds: [4]\nbudget: {BUDGET}\nsettings: {shared}\n"
    )
    return file


def start(graph: Graph, file: Path) -> Started:
    return graph.launch([sys.executable, "-m", "pga_me_ros.experiment", str(file), "--jobs", "1"])


def test_an_experiment_resumes_where_it_was_stopped_and_continues_after_a_failure(
    graph: Graph, experiment: Path
) -> None:
    folder = graph.folder / "experiments" / "tiny"
    runs = {name: folder / name / TASK / "seed4" for name in ALGORITHMS}

    stopped = start(graph, experiment)
    stopped.wait_for_output("finished half/qd_hopper/4", PATIENCE)
    second = start(graph, experiment)
    assert second.wait() == 2
    assert "is being written by another process" in second.output
    stopped.signal(signal.SIGINT)
    assert stopped.wait() == 128 + signal.SIGINT
    assert (
        "stopped: 1 of 3 runs in experiments/tiny are finished; the same command" in stopped.output
    )
    for run in runs.values():
        wait_for_no_children(run)
    done = (runs["half"] / "repertoire.db").stat().st_mtime_ns

    again = start(graph, experiment)
    assert again.wait(PATIENCE) == 1
    log = "experiments/tiny/lost/qd_hopper/seed4.log"
    assert re.search(
        rf"^failed: lost/qd_hopper/4: .*no repertoire 'nowhere'.* See {log}", again.output, re.M
    )
    assert "2 of 3 runs in experiments/tiny are finished" in again.output
    assert (graph.folder / log).exists()
    assert (runs["half"] / "repertoire.db").stat().st_mtime_ns == done, "a finished run was touched"
    for name, run in runs.items():
        expected = search_digest(task=TASK, seed=4, evaluations=BUDGET, n_evo=ALGORITHMS[name])
        assert run_digest(run) == expected, name
        assert_best_controllers_were_reevaluated(run)


def assert_best_controllers_were_reevaluated(run: Path) -> None:
    with Repertoire.open(run / "repertoire.db", read_only=True) as repertoire:
        rows = Reevaluations.load(repertoire.path, repertoire.info.run_id, 1)
        best = sorted({m.best_evaluation for m in repertoire.metrics()})
    assert sorted(rows.evaluation.tolist()) == sorted(best * REPEATS)
