"""The same command resumes a run that was killed or has finished; test_chaos.py kills everything else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from graph import Graph
from processes import children, kill_orchestrator, wait_for_no_children
from reference import ES, run_digest, search_digest

LONG: dict[str, Any] = {"evaluations": 80}
"""Evaluations for enough generations of variation to be in the middle of one when something is killed."""

KINDS = ("evaluator_0", "critic_trainer", "variation", "archive_manager")


@pytest.mark.parametrize(
    "system",
    [
        {"n_crit": 100},
        {"algorithm": "td3"},
        {**ES, "seed": 3, "evaluations": 160},
        {"algorithm": "qd_rl", "n_crit": 100},
        {"algorithm": "dcrl_map_elites", "n_crit": 100},
    ],
    ids=["pga", "td3", "map_elites_es", "qd_rl", "dcrl_map_elites"],
)
def test_a_killed_orchestrator_leaves_no_orphan_and_the_same_command_resumes(
    graph: Graph, tmp_path: Path, system: dict[str, Any]
) -> None:
    run_dir, parameters = tmp_path / "run", {**LONG, **system}
    run = graph.run(run_dir, **parameters)
    run.wait_for_output("generation 4/")
    assert set(children(run_dir)) == set(KINDS)
    kill_orchestrator(run)
    wait_for_no_children(run_dir)
    again = graph.run(run_dir, **parameters)
    assert again.wait() == 0, again.output
    assert run_digest(run_dir) == search_digest(**parameters)


EXTRACTION = {"extract_share": 0.3, "cell_depth": 3}
"""Settings of a run whose cells hold several solutions, which a resumed run needs as they were."""


@pytest.mark.parametrize(
    ("evaluations", "more"),
    [
        pytest.param(20, EXTRACTION, id="extraction"),
        pytest.param(10, {"greedy_init": "best", "reevaluations": 2}, id="greedy_init"),
    ],
)
def test_a_raised_budget_continues_a_finished_run(
    graph: Graph, tmp_path: Path, evaluations: int, more: dict[str, Any]
) -> None:
    run_dir = tmp_path / "run"
    first = graph.run(run_dir, evaluations=evaluations, **more)
    assert first.wait() == 0, first.output
    second = graph.run(run_dir, evaluations=40, **more)
    assert second.wait() == 0, second.output
    assert run_digest(run_dir) == search_digest(evaluations=40, **more)
