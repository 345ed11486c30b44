"""Evaluators that come and go during a run, and several with the same name."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
from graph import NOT_ALONE, Graph, Probe, Started, wait_until
from pga_me_msgs.msg import NodeStatus
from reference import evaluations_of, run_digest, search_digest

from pga_me_ros.ros import names, qos

WALKER = {"task": "qd_walker"}


@pytest.fixture
def signs(probe: Probe) -> list[Any]:
    """Return a list of all nodes' heartbeats."""
    return probe.listen(NodeStatus, names.STATUS, qos.STATUS)


def wait_for_work(signs: list[Any], evaluator: Started, since: int = 0) -> None:
    """Wait until heartbeats, from index `since`, show that an evaluator has done some work."""

    def has_worked() -> bool:
        done = {s.done for s in signs[since:] if s.pid == evaluator.process.pid}
        return len(done) > 1

    wait_until(has_worked, "work of an evaluator that joined")


def test_evaluators_join_and_leave_in_every_way(
    graph: Graph, signs: list[Any], tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    run = graph.run(run_dir, evaluations=100_000)
    quits, hangs = graph.start("evaluator", WALKER), graph.start("evaluator", WALKER)
    wait_for_work(signs, hangs)
    hangs.signal(signal.SIGSTOP)
    wait_for_work(signs, quits)
    quits.signal(signal.SIGTERM)
    assert quits.wait() == 0
    assert "Traceback" not in quits.output
    assert "Exception in" not in quits.output
    run.wait_for_output("has been silent")
    returned_to = len(signs)
    hangs.signal(signal.SIGCONT)
    wait_for_work(signs, hangs, returned_to)
    hangs.signal(signal.SIGKILL)
    hangs.wait()
    done = run.output.count("generation")
    wait_until(lambda: run.output.count("generation") > done + 1, "generations without them")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0, run.output
    assert run_digest(run_dir) == search_digest(evaluations=evaluations_of(run_dir))


def test_an_evaluator_leaves_its_name_to_an_older_one(graph: Graph, signs: list[Any]) -> None:
    arguments = ("evaluator", WALKER, "-r", "__node:=mine")
    first = graph.start(*arguments)
    wait_until(lambda: any(s.node == "/mine" for s in signs), "the first one's heartbeat")
    second = graph.start(*arguments)
    assert second.wait() == 2
    assert f"The name /mine is taken in this ROS domain by process {first.process.pid}" in (
        second.output
    )
    assert "-r __node:=NAME" in second.output
    assert "Traceback" not in second.output
    assert "Exception in" not in second.output
    assert first.process.poll() is None


def test_a_run_does_not_start_if_its_evaluators_names_are_taken(
    graph: Graph, signs: list[Any], tmp_path: Path
) -> None:
    """Otherwise, requests of the run would also reach the namesake, and be refused if it has another task."""
    before = graph.start("evaluator", {"task": "qd_hopper"}, "-r", "__node:=evaluator_0")
    wait_until(lambda: any(s.node == "/evaluator_0" for s in signs), "a stranger of that name")
    run = graph.run(tmp_path / "run", **NOT_ALONE)
    assert run.wait() == 2
    assert f"The name /evaluator_0 (process {before.process.pid}" in run.output
