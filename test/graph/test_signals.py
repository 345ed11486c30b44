"""Stopping, pausing and tuning a run from outside."""

from __future__ import annotations

import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domain_coordinator import domain_id
from graph import DEADLINE, TINY, Graph, Probe, Started, ros_arguments, wait_until
from pga_me_msgs.msg import Progress, Transitions
from pga_me_msgs.srv import Evaluate
from processes import children, wait_for_no_children
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from reference import run_digest, search_digest
from screen import Terminal
from std_srvs.srv import Trigger

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import flat

SOON = 5.0
"""Seconds within which a run ends after it was told to stop."""

COLUMNS = 200

LONG = {"evaluations": 100_000}
"""Parameters of a run that does not end by itself within a test."""


def under_way(graph: Graph, run_dir: Path, **parameters: Any) -> Started:
    run = graph.run(run_dir, **parameters)
    run.wait_for_output("generation 2/")
    return run


@contextmanager
def in_terminal(graph: Graph, run_dir: Path) -> Iterator[Terminal]:
    """Start an endless run in a terminal, and wait until it is under way."""
    values = {**TINY, **LONG, "run_dir": run_dir}
    command = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator", *ros_arguments(values)]
    terminal = Terminal(command, COLUMNS, graph.environment, graph.folder)
    try:
        under_way = re.compile("generation (?!0/|1/)")
        wait_until(lambda: any(map(under_way.search, terminal.rows)), "generation 2")
        yield terminal
    finally:
        terminal.close()


def end(run: Started) -> None:
    run.signal(signal.SIGTERM)
    run.wait()


def press_ctrl_c(terminal: Terminal) -> None:
    terminal.type(b"\x03")


def terminate(terminal: Terminal) -> None:
    terminal.process.send_signal(signal.SIGTERM)


@pytest.mark.parametrize("tell_to_end", [press_ctrl_c, terminate])
def test_a_signal_stops_soon_and_says_how_to_resume(
    graph: Graph, tmp_path: Path, tell_to_end: Callable[[Terminal], None]
) -> None:
    run_dir = tmp_path / "run"
    with in_terminal(graph, run_dir) as terminal:
        sent = time.monotonic()
        tell_to_end(terminal)
        assert terminal.process.wait(DEADLINE) == 0, terminal.rows
    assert time.monotonic() - sent < SOON
    assert not children(run_dir)
    output = "".join(terminal.rows)  # a long line takes several rows
    assert "evaluations are safe" in output
    assert "the same command resumes" in output
    assert "Traceback" not in output
    assert "Exception in" not in output


def test_a_run_ends_as_a_whole_when_its_terminal_is_closed(graph: Graph, tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    with in_terminal(graph, run_dir) as terminal:
        assert len(children(run_dir)) == 4
        terminal.hang_up()
        assert terminal.process.wait(SOON) == -signal.SIGHUP
    wait_for_no_children(run_dir)


def test_a_stopped_run_resumes_with_the_same_command(graph: Graph, tmp_path: Path) -> None:
    run_dir, parameters = tmp_path / "run", {"evaluations": 60, "n_crit": 100}
    end(under_way(graph, run_dir, **parameters))
    again = graph.run(run_dir, **parameters)
    assert again.wait() == 0, again.output
    assert run_digest(run_dir) == search_digest(**parameters)


def test_more_signals_leave_neither_traceback_nor_orphan(graph: Graph, tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    run = under_way(graph, run_dir, **LONG)

    def has_ended() -> bool:
        run.signal(signal.SIGINT)
        return run.process.poll() is not None

    wait_until(has_ended, "the end")
    assert run.process.returncode == 130, run.output
    assert "Traceback" not in run.output
    assert "Exception in" not in run.output
    wait_for_no_children(run_dir)


def test_a_signal_while_the_run_starts_ends_it(graph: Graph, tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    run = graph.run(run_dir, **LONG)
    wait_until(lambda: "critic_trainer" in children(run_dir), "the first children")
    run.signal(signal.SIGINT)
    assert run.wait(SOON) == 0, run.output
    assert "Traceback" not in run.output
    assert "Exception in" not in run.output
    assert not children(run_dir)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_a_signal_in_the_middle_of_an_episode_ends_an_evaluator_quietly(
    graph: Graph, probe: Probe, number: signal.Signals
) -> None:
    heard = probe.listen(Transitions, names.TRANSITIONS, qos.EXPERIENCE_READER)
    evaluator = graph.start("evaluator", {"task": "qd_half_cheetah"}, "-r", "__node:=mine")
    client = probe.node.create_client(Evaluate, "mine/evaluate")
    wait_until(client.service_is_ready, "the evaluator")
    shape = MlpShape((26, 8, 6))  # for a robot that never falls, so that every episode is long
    request = Evaluate.Request(task="qd_half_cheetah", evaluations=range(50))
    request.layer_sizes = list(shape.sizes)
    request.parameters = flat(np.zeros((50, shape.parameter_count)), "f")
    client.call_async(request)
    wait_until(lambda: bool(heard), "the first episode")
    evaluator.signal(number)
    assert evaluator.wait(SOON) == 0
    usual = "nodes are found on this machine only"
    assert [line for line in evaluator.output.splitlines() if usual not in line] == []


@dataclass
class LongRun:
    """A run that goes on after each test."""

    run_dir: Path
    run: Started
    probe: Probe
    heard: list[Progress]

    def pause(self) -> int:
        """Pause it; return its newest generation."""
        assert self.probe.call(Trigger, "orchestrator/pause").success
        wait_until(lambda: self.heard[-1].state == "paused", "the pause")
        return int(self.heard[-1].generation)

    def resume(self) -> None:
        """Resume it, and wait for a generation that began afterwards."""
        at = self.heard[-1].generation
        assert self.probe.call(Trigger, "orchestrator/resume").success
        wait_until(lambda: self.heard[-1].generation > at, "the next generation")


@pytest.fixture(scope="module")
def long_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LongRun]:
    folder = tmp_path_factory.mktemp("long")
    with domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph, probe = Graph(domain, folder), Probe(domain)
        try:
            heard = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
            run = under_way(graph, folder / "run", **LONG)
            yield LongRun(folder / "run", run, probe, heard)
            end(run)
        finally:
            probe.close()
            graph.kill()


def test_a_paused_run_does_nothing_until_it_is_resumed(long_run: LongRun) -> None:
    heard = long_run.heard
    at = long_run.pause()
    count = len(heard)
    wait_until(lambda: len(heard) > count + 2, "heartbeats of a paused run")
    assert heard[-1].generation == at
    long_run.resume()
    assert not long_run.probe.call(Trigger, "orchestrator/resume").success


def set_parameters(probe: Probe, **values: Any) -> Sequence[Any]:
    """Set parameters of the orchestrator in one request, and return the results."""
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    response = probe.call(SetParameters, "orchestrator/set_parameters", parameters=parameters)
    return list(response.results)


def test_a_rate_takes_effect_at_the_next_generation_and_is_recorded(long_run: LongRun) -> None:
    at = long_run.pause()
    changed = set_parameters(long_run.probe, n_evo=7, iso_sigma=0.5)
    long_run.resume()
    long_run.pause()
    restored = set_parameters(long_run.probe, n_evo=5, iso_sigma=0.005)
    long_run.resume()
    assert all(result.successful for result in (*changed, *restored))
    with Repertoire.open(long_run.run_dir / "repertoire.db", read_only=True) as repertoire:
        rates, metrics = repertoire.rates(), repertoire.metrics()
    assert [(r["n_evo"], r["iso_sigma"]) for r in rates[at : at + 2]] == [(5, 0.005), (7, 0.5)]
    made = [dict(zip(Operator, m.offspring, strict=True)) for m in metrics[at : at + 2]]
    assert [(m[Operator.GREEDY], m[Operator.GA], m[Operator.PG]) for m in made] == [
        (1, 5, 4),
        (1, 7, 2),
    ]
    assert [sum(m.values()) for m in made] == [10, 10]


def test_parameters_of_a_resumed_run_show_the_rates_in_force(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    run = under_way(graph, run_dir, **LONG)
    assert all(result.successful for result in set_parameters(probe, n_evo=7, iso_sigma=0.5))
    run.wait_for_output("from the next generation: iso_sigma")
    at = run.output.count("generation")
    wait_until(lambda: run.output.count("generation") > at + 2, "generations with the new rates")
    end(run)
    again = graph.run(run_dir, **LONG)
    again.wait_for_output("resumed the run")
    response = probe.call(
        GetParameters, "orchestrator/get_parameters", names=["n_evo", "iso_sigma"]
    )
    end(again)
    n_evo, iso_sigma = response.values
    assert (n_evo.integer_value, iso_sigma.double_value) == (7, 0.5)


def test_bad_changes_are_refused_with_a_reason(long_run: LongRun) -> None:
    probe = long_run.probe
    refused = {
        "too large": set_parameters(probe, discount=1.5)[0],
        "more than the batch": set_parameters(probe, n_evo=11)[0],
        "wrong type": set_parameters(probe, n_grad="many")[0],
        "structural": set_parameters(probe, batch_size=20)[0],
        "unknown": set_parameters(probe, n_evolution=3)[0],
    }
    assert not any(result.successful for result in refused.values())
    assert all(result.reason for result in refused.values())
    assert "batch_size=10" in refused["more than the batch"].reason
