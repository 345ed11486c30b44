"""Bad input to real processes: one clear line, exit code 2, no traceback, nothing left running, nothing lost."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pytest
from domain_coordinator import domain_id
from graph import NOT_ALONE, TINY, Graph, Started, ros_arguments, tiny
from processes import children
from reference import run_digest, search_digest

from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import task_spec

REFUSED = 2

ONE_GENERATION = {"evaluations": 10}

BROKEN_TASKS = """
import dataclasses

from pga_me_ros.tasks.bullet.locomotion import QDHopper


class Unplugged(QDHopper):
    def __init__(self):
        raise RuntimeError("no servo answers")


class Stumbling(QDHopper):
    def step(self, action):
        raise RuntimeError("lost a leg")


class Reticent(QDHopper):
    spec = dataclasses.replace(QDHopper.spec, step_descriptor_names=())
"""

SWINGING = """
import gymnasium
import numpy as np


def height(observations, actions):
    return [float(observations[:, 0].mean())]


height.low, height.high = [-1.0], [1.0]


class GivesNan(gymnasium.ObservationWrapper):
    def observation(self, observation):
        return observation * np.nan
"""


def refusal(graph: Graph, kind: str, *arguments: str) -> str:
    """Start a node that must refuse, and return its message without ``error:``."""
    done = subprocess.run(
        [sys.executable, "-m", f"pga_me_ros.nodes.{kind}", *arguments],
        env=graph.environment,
        cwd=graph.folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == REFUSED, done.stderr + done.stdout
    lines = [line for line in done.stderr.splitlines() if "[WARN]" not in line]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    return lines[0].removeprefix("error: ")


def refused_run(graph: Graph, run_dir: Path, *arguments: str, **parameters: Any) -> str:
    """Start a tiny run that must be refused; return its message."""
    values: Mapping[str, Any] = tiny(**{**ONE_GENERATION, "run_dir": run_dir, **parameters})
    words = refusal(graph, "orchestrator", *ros_arguments(values), *arguments)
    assert not children(run_dir)
    return words


def make_run(run_dir: Path) -> Path:
    """Make the directory of a tiny run that was stopped before its first generation; return its repertoire."""
    known = {f.name for f in fields(Settings)}
    settings = Settings.from_mapping({n: v for n, v in TINY.items() if n in known})
    directory = open_run(run_dir, task_spec(settings.task), settings)
    directory.lock.release()
    return directory.repertoire


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"task": "qd_wlker"}, "unknown task 'qd_wlker' (did you mean 'qd_walker'?)"),
        ({"task": "nope.mod:X"}, "module 'nope.mod' does not load"),
        ({"evaluatons": 5}, "Unknown parameter 'evaluatons' (did you mean 'evaluations'?)"),
        ({"evaluations": "abc"}, "evaluations must be an integer, not 'abc'"),
        ({"iso_sigma": -1.0}, "iso_sigma is -1.0; expected a value from 0.0 to 100.0."),
        ({"reevaluations": -1}, "reevaluations is -1; expected a value from 0 to 10000"),
        ({"randomization": "mass 1.2 0.8"}, "mass 1.2 to 0.8; give the smaller number first"),
        ({"randomization": "masses 1 2"}, "has 'masses 1 2' (did you mean 'mass'?)"),
        ({"extract_share": 0.01}, "extract_share is 0.01, which is 0 of a batch of 10"),
        ({"cells": 3000}, "3000 cells cannot be made of 2000 samples; give"),
        ({"task": "gymnasium:Hoper-v5"}, "no environment 'Hoper-v5' (did you mean 'Hopper-v5'?)"),
        ({"task": "gymnasium:CartPole-v1"}, "action space Discrete(2); expected a Box"),
        ({"task": "gymnasium:Hopper-v5?descriptor=nope:reach"}, "'nope:reach' does not load"),
    ],
    ids=lambda case: next(iter(case)) if isinstance(case, dict) else "",
)
def test_an_invalid_parameter(
    graph: Graph, tmp_path: Path, parameters: dict[str, Any], words: str
) -> None:
    assert words in refused_run(graph, tmp_path / "run", **parameters)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--hlep", "Unknown argument '--hlep' (did you mean '--help'?)"),
        ("--ros-args -p evaluations", "'-p evaluations'; expected -p NAME:=VALUE"),
        (
            "--ros-args -r __ns:=one",
            "Namespace 'one' does not begin with a slash; expected -r __ns:=/one",
        ),
        ("--ros-args -z", "Unknown ROS argument '-z'"),
        ("--ros-args --params-file none.yaml", "There is no params file 'none.yaml'"),
        ("--ros-args --params-file bad.yaml", "not valid YAML at line 2, column 1"),
        ("--ros-args --params-file mixed.yaml", "all of one type"),
    ],
)
def test_an_invalid_command_line(graph: Graph, tmp_path: Path, arguments: str, words: str) -> None:
    (tmp_path / "bad.yaml").write_text("a: [1\n")
    (tmp_path / "mixed.yaml").write_text("/**: {ros__parameters: {controller_hidden: [1, a]}}\n")
    assert words in refusal(graph, "evaluator", *arguments.split())


@pytest.mark.parametrize("kind", ["archive_manager", "evaluator", "critic_trainer", "variation"])
def test_every_other_node_refuses_a_misspelled_parameter(graph: Graph, kind: str) -> None:
    assert refusal(graph, kind, *ros_arguments({"tusk": "qd_ant"})).startswith(
        "Unknown parameter 'tusk'"
    )


@pytest.mark.parametrize("place", ["/proc/run", "file", "file/below"])
def test_a_run_directory_that_cannot_be_written(graph: Graph, tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    words = refused_run(graph, tmp_path / place)
    assert words.startswith(f"Cannot make the folder '{tmp_path / place}'")


def test_a_run_directory_of_another_run(graph: Graph, tmp_path: Path) -> None:
    file = make_run(tmp_path / "run")
    before = file.read_bytes()
    words = refused_run(graph, tmp_path / "run", task="qd_ant")
    assert "task: qd_walker != qd_ant. Start it with its own settings or choose another" in words
    assert "seed: 0 != 1. " in refused_run(graph, tmp_path / "run", seed=1)
    assert file.read_bytes() == before


def test_a_damaged_repertoire(graph: Graph, tmp_path: Path) -> None:
    file = make_run(tmp_path / "run")
    before = file.read_bytes()[:-20000]
    file.write_bytes(before)
    words = refused_run(graph, tmp_path / "run")
    assert "repertoire.db': it is damaged" in words
    assert words.endswith("Restore it from a copy, or start a new run in another folder.")
    assert file.read_bytes() == before


def test_a_task_that_does_not_start_ends_the_run_with_its_reason(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_robots.py").write_text(BROKEN_TASKS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    words = refused_run(graph, tmp_path / "run", task="my_robots:Unplugged")
    assert "'my_robots:Unplugged' does not start (RuntimeError: no servo answers)" in words


def test_a_task_that_lacks_what_the_algorithm_needs_is_refused_before_anything_starts(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_robots.py").write_text(BROKEN_TASKS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    run_dir, parameters = tmp_path / "run", {"algorithm": "qd_rl"}
    words = refused_run(graph, run_dir, task="my_robots:Reticent", **parameters)
    assert "Task 'qd_hopper' has no state descriptors" in words
    assert not run_dir.exists()


def test_a_task_without_a_bounded_descriptor_is_refused_before_anything_starts(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "endless.py").write_text(
        "import dataclasses, math\n"
        "from pga_me_ros.tasks.bullet.locomotion import QDHopper\n\n\n"
        "class Endless(QDHopper):\n"
        "    spec = dataclasses.replace(QDHopper.spec, descriptor_high=(math.inf,))\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    run_dir = tmp_path / "run"
    words = refused_run(graph, run_dir, task="endless:Endless", algorithm="dcrl_map_elites")
    assert "descriptor_low[0] is 0.0 and descriptor_high[0] is inf; expected finite num" in words
    assert not run_dir.exists()


def test_a_task_that_fails_during_the_run_ends_the_run_with_its_reason(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_robots.py").write_text(BROKEN_TASKS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    words = refused_run(graph, tmp_path / "run", task="my_robots:Stumbling")
    assert "cannot be done: internal fault: RuntimeError: lost a leg" in words


def test_an_environment_that_fails_during_the_run_ends_it_with_the_reason(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "swinging.py").write_text(SWINGING)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    options = "descriptor=swinging:height&wrapper=swinging:GivesNan&max_steps=20"
    said = refused_run(graph, tmp_path / "run", task=f"gymnasium:Pendulum-v1?{options}")
    assert "left the finite numbers" in said


@dataclass
class Serving:
    """A finished run that serves its repertoire, and the domain that it is in."""

    run_dir: Path
    run: Started
    graph: Graph


@pytest.fixture(scope="module")
def serving(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    folder = tmp_path_factory.mktemp("serving")
    with domain_id() as domain:
        graph = Graph(domain, folder)
        try:
            run = graph.run(folder / "run", **ONE_GENERATION, serve=True)
            run.wait_for_output("serving it")
            yield Serving(folder / "run", run, graph)
        finally:
            graph.kill()


def test_a_second_orchestrator_is_refused_by_name_or_by_directory_and_the_first_is_unaffected(
    serving: Serving, tmp_path: Path
) -> None:
    first, graph = serving.run, serving.graph
    same_name = refused_run(graph, tmp_path / "other", **NOT_ALONE)
    assert f"runs as /orchestrator (process {first.process.pid} on" in same_name
    assert not (tmp_path / "other").exists()
    elsewhere = ("-r", "__ns:=/elsewhere")
    arguments = ros_arguments({**TINY, "run_dir": serving.run_dir})
    same_folder = refusal(graph, "orchestrator", *arguments, *elsewhere)
    assert f"being written by another process (pid {first.process.pid} on" in same_folder
    assert first.process.poll() is None


def test_two_runs_in_two_namespaces_do_not_mix(graph: Graph, tmp_path: Path) -> None:
    runs = {
        name: graph.run(tmp_path / name, "-r", f"__ns:=/{name}", seed=seed)
        for name, seed in {"one": 1, "two": 2}.items()
    }
    for run in runs.values():
        assert run.wait() == 0, run.output
    for name, seed in {"one": 1, "two": 2}.items():
        assert run_digest(tmp_path / name) == search_digest(seed=seed)


def test_a_foreign_archive_manager_keeps_a_run_from_starting(graph: Graph, tmp_path: Path) -> None:
    foreign = graph.start("archive_manager", {"repertoire": make_run(tmp_path / "old")})
    words = refused_run(graph, tmp_path / "run", **NOT_ALONE)
    assert f"The name /archive_manager (process {foreign.process.pid} on" in words
    assert not (tmp_path / "run").exists()
    assert foreign.process.poll() is None


def test_a_run_keeps_a_second_archive_manager_from_serving(
    serving: Serving, tmp_path: Path
) -> None:
    repertoire = make_run(tmp_path / "old")
    words = refusal(serving.graph, "archive_manager", *ros_arguments({"repertoire": repertoire}))
    holder = children(serving.run_dir)["archive_manager"]
    assert f"The name /archive_manager is taken in this ROS domain by process {holder} on" in words
    assert serving.run.process.poll() is None
