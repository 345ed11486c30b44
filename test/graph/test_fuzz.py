"""A foreign node sends anything to everything during a run, and the run's result is unaffected."""

from __future__ import annotations

from pathlib import Path

from fuzzer import Fuzzer
from graph import Graph, Probe, wait_until
from pga_me_msgs.msg import Progress
from processes import children
from reference import run_digest, run_settings, search_digest
from std_srvs.srv import Trigger

from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.ros import names, qos

CASES = 300


def test_a_run_refuses_whatever_is_sent_and_its_result_is_unaffected(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    run = graph.run(run_dir, evaluations=100_000)
    progress = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    fuzzer = Fuzzer(probe, run_settings())
    before = children(run_dir)
    fuzzer.fuzz(CASES)
    assert fuzzer.wrong == []
    assert sum(fuzzer.sent.values()) >= CASES
    assert sum(fuzzer.refusals.values()) > CASES / 4
    after = fuzzer.generation
    wait_until(lambda: fuzzer.generation > after, "another generation")
    assert children(run_dir) == before, run.output
    assert progress[-1].restarts == 0
    probe.call(Trigger, "orchestrator/stop")
    assert run.wait() == 0, run.output
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        done = len(repertoire.metrics())
    assert run_digest(run_dir) == search_digest(evaluations=10 * done)
