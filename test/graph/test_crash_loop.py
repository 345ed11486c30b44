"""A node that dies or fails repeatedly ends the run with its reason; nothing that was committed is lost."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from graph import Graph
from processes import children
from reference import run_digest, search_digest

FAILED = 2
BUDGET = {"evaluations": 60}

TASKS = """
import os
from pathlib import Path

from pga_me_ros.tasks.bullet.locomotion import QDWalker


THUNDERSTORM = Path("thunderstorm")


class Deadly(QDWalker):
    def __init__(self):
        if THUNDERSTORM.exists():
            print("the battery is empty", flush=True)
            os._exit(3)
        super().__init__()

    def step(self, action):
        if THUNDERSTORM.exists():
            os._exit(7)
        return super().step(action)
"""

UNTEACHABLE = """
import sys

from pga_me_ros.tasks.bullet.locomotion import QDWalker


def fail(*_):
    raise RuntimeError("the driver has gone")


if "pga_me_ros.nodes.critic_trainer" in sys.orig_argv:
    from pga_me_ros.core.learning.critic_trainer import CriticTrainer

    CriticTrainer.train = fail
"""


@pytest.fixture(autouse=True)
def robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robots.py").write_text(TASKS)
    (tmp_path / "unteachable.py").write_text(UNTEACHABLE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)


def test_an_evaluator_that_dies_repeatedly_ends_the_run_which_resumes_after_a_repair(
    graph: Graph, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    run = graph.run(run_dir, **BUDGET, task="robots:Deadly")
    run.wait_for_output("generation 2/")
    (tmp_path / "thunderstorm").touch()
    assert run.wait() == FAILED, run.output
    *_, kept, error = run.output.splitlines()
    assert error == (
        "error: Node 'evaluator_0' crashed 5 times without completing a generation, the last time with exit code 3; "
        f"its last output: 'the battery is empty'. See {run_dir}/logs/evaluator_0.log."
    )
    assert "evaluations are safe in" in kept
    assert "the same command resumes" in kept
    assert "Traceback" not in run.output
    assert not children(run_dir)
    (tmp_path / "thunderstorm").unlink()
    again = graph.run(run_dir, **BUDGET, task="robots:Deadly")
    assert again.wait() == 0, again.output
    assert run_digest(run_dir) == search_digest(**BUDGET)


def test_a_training_that_fails_ends_the_run_with_its_reason(graph: Graph, tmp_path: Path) -> None:
    run = graph.run(tmp_path / "run", task="unteachable:QDWalker")
    assert run.wait() == FAILED, run.output
    assert "the driver has gone" in run.output.splitlines()[-1]
    assert "10 evaluations are safe in" in run.output
    assert "Traceback" not in run.output
