"""The demonstration of adaptation with its nodes: the trials are the library's, and nothing is left behind."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest
from graph import Graph, Started, wait_until

from pga_me_ros.adapt_demo.robot import Robot, Way
from pga_me_ros.core.adaptation.adaptation import Adaptation
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.tasks.registry import make_task

DAMAGE = "free leg_joint"


def start(graph: Graph, run: Path, *words: str) -> Started:
    """Start the demonstration, with its temporary files in the graph's folder."""
    temporary = graph.folder / "temporary"
    temporary.mkdir()
    command = [sys.executable, "-m", "pga_me_ros.adapt_demo", str(run), "--damage", DAMAGE]
    return graph.launch(["env", f"TMPDIR={temporary}", *command, *words])


def children(started: Started) -> list[int]:
    """Return the ids of a process's children."""
    pid = started.process.pid
    return [int(c) for c in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def in_the_library(run: Path, budget: int) -> list[tuple[int, str]]:
    """Return cell and fitness of each trial of the same adaptation without ROS."""
    stored = StoredRun.load(run)
    settings = AdaptationSettings(budget=budget, length_scale=0.1)
    adaptation = Adaptation(PerformanceMap.of(stored.choices()), settings)
    task, rng = make_task("qd_hopper", damage=DAMAGE), Way.ADAPT.generator(0)
    while trial := adaptation.next():
        controller = stored.behavior(trial.cell).controller
        adaptation.report(Robot(task).trial(controller, rng).fitness)
    task.close()
    return [(trial.cell, f"{trial.achieved:.0f}") for trial in adaptation.trials]


def test_it_makes_the_trials_of_the_library_and_draws_them(graph: Graph, hopper_run: Path) -> None:
    picture = graph.folder / "picture.svg"
    demo = start(graph, hopper_run, "--budget", "3", "--length-scale", "0.1", "--out", str(picture))
    assert demo.wait() == 0, demo.output
    rows = [line.split() for line in demo.output.splitlines()]
    begun = rows.index(["trial", "cell", "promised", "expected", "achieved"]) + 1
    expected = in_the_library(hopper_run, 3)
    told = [(int(row[1]), row[4]) for row in rows[begun : begun + len(expected)]]
    assert told == expected
    assert f"over after {len(expected)} trial" in demo.output
    for words in ("sound", f"damaged: {DAMAGE}", "random search", "hill climb, 20 trials"):
        assert words in demo.output
    assert f"trial {len(expected)} achieves" in picture.read_text()
    assert not list((graph.folder / "temporary").iterdir())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_node_survives_it(graph: Graph, hopper_run: Path, number: signal.Signals) -> None:
    demo = start(graph, hopper_run, "--out", "picture.png")
    wait_until(lambda: len(children(demo)) == 2, f"both nodes:\n{demo.output}")
    nodes = children(demo)
    demo.signal(number)
    code = demo.wait()
    wait_until(lambda: not any(is_alive(pid) for pid in nodes), "the end of the nodes", 20.0)
    assert not (graph.folder / "picture.png").exists()
    if number != signal.SIGKILL:
        assert code == 128 + number
        assert demo.output.splitlines()[-1] == "stopped"
        assert "Traceback" not in demo.output
        assert not list((graph.folder / "temporary").iterdir())


def is_alive(pid: int) -> bool:
    """Whether a process is there; one that was left by its parent is cleared away by the system."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
