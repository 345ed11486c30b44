"""Watching a run: /diagnostics of every node, logs and metrics.csv in the run directory, the last line."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from domain_coordinator import domain_id
from graph import Graph, Probe, Started, wait_until
from pga_me_msgs.srv import GetBehavior
from processes import children

from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.ros import qos

SOME_SECONDS = {"evaluations": 150, "n_crit": 200}
"""Long enough to hear every node while it works."""

NODES = {"orchestrator", "archive_manager", "critic_trainer", "variation", "evaluator_0"}
VALUES = {"rate (1/s)", "done", "queue", "refused", "last error", "memory RSS (MiB)", "host", "pid"}


class Watched:
    """A finished run that is being served, and everything received on /diagnostics."""

    def __init__(self, folder: Path, graph: Graph, probe: Probe) -> None:
        self.run_dir = folder / "run"
        self.probe = probe
        self.heard: list[DiagnosticArray] = probe.listen(
            DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS
        )
        self.run: Started = graph.run(self.run_dir, **SOME_SECONDS, serve=True)
        self.run.wait_for_output("serving it")
        with Repertoire.open(self.run_dir / "repertoire.db", read_only=True) as repertoire:
            self.run_id = repertoire.info.run_id

    def entries(self, name: str) -> list[DiagnosticStatus]:
        """Return the entries about a node, newest last."""
        return [s for msg in list(self.heard) for s in msg.status if s.name == f"/{name}"]


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    folder = tmp_path_factory.mktemp("watched")
    with domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph, probe = Graph(domain, folder), Probe(domain)
        try:
            yield Watched(folder, graph, probe)
        finally:
            probe.close()
            graph.kill()


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


@pytest.mark.parametrize("name", sorted(NODES))
def test_every_node_reports_its_health(watched: Watched, name: str) -> None:
    newest = watched.entries(name)[-1]
    assert newest.level == DiagnosticStatus.OK, newest.message
    assert newest.hardware_id == watched.run_id
    assert values(newest).keys() >= VALUES
    assert float(values(newest)["memory RSS (MiB)"]) > 10


def test_the_orchestrator_reports_the_health_of_the_run(watched: Watched) -> None:
    wait_until(
        lambda: values(watched.entries("orchestrator")[-1])["state"] == "finished", "the end"
    )
    found = values(watched.entries("orchestrator")[-1])
    assert (found["done"], found["restarts"], found["queue"]) == ("150", "0", "0")


def test_a_refusal_shows_as_a_warning(watched: Watched) -> None:
    watched.probe.call(GetBehavior, "repertoire/get_behavior", select=77)
    wait_until(
        lambda: watched.entries("archive_manager")[-1].level == DiagnosticStatus.WARN, "a warning"
    )
    newest = watched.entries("archive_manager")[-1]
    assert "select is 77" in newest.message
    assert (values(newest)["refused"], values(newest)["last error"]) == ("1", newest.message)


def test_a_node_that_goes_silent_is_stale_until_it_is_heard_again(watched: Watched) -> None:
    def stale() -> bool:
        return watched.entries("archive_manager")[-1].level == DiagnosticStatus.STALE

    pid = children(watched.run_dir)["archive_manager"]
    os.kill(pid, signal.SIGSTOP)
    try:
        wait_until(stale, "a stale entry")
        assert "no heartbeat" in watched.entries("archive_manager")[-1].message
    finally:
        os.kill(pid, signal.SIGCONT)
    wait_until(lambda: not stale(), "a heartbeat")


def test_every_node_has_a_log_in_the_run_directory(watched: Watched) -> None:
    logs = watched.run_dir / "logs"
    assert {path.stem for path in logs.iterdir()} == NODES
    assert "finished: " in (logs / "orchestrator.log").read_text()


def test_the_table_of_metrics_grows_with_the_run(watched: Watched) -> None:
    rows = (watched.run_dir / "metrics.csv").read_text().splitlines()
    assert [row.partition(",")[0] for row in rows] == ["generation", *map(str, range(15))]


def test_the_last_line_is_a_summary(watched: Watched) -> None:
    line = next(line for line in watched.run.output.splitlines() if line.startswith("finished: "))
    assert re.search(r"\(0 restarts, \d+ re-evaluations, 0 refused requests\)", line), line
