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

PUBLISHED = {
    f"/{name}".replace("//", "/")
    for name in (
        names.TRANSITIONS,
        names.SNAPSHOT,
        names.ELITES,
        names.METRICS,
        names.HEATMAP,
        names.GRID,
        names.PROGRESS,
        names.STATUS,
        names.DIAGNOSTICS,
    )
}
"""Topics of a run of two descriptors, which somebody looks at meanwhile."""


def test_a_run_refuses_whatever_is_sent_and_its_result_is_unaffected(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    run = graph.run(run_dir, evaluations=100_000)
    progress = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    fuzzer = Fuzzer(probe, run_settings())
    assert set(fuzzer.heard) >= PUBLISHED
    before, looked = children(run_dir), fuzzer.heard.copy()
    fuzzer.fuzz(CASES)
    assert fuzzer.wrong == []
    assert sum(fuzzer.sent.values()) >= CASES
    assert sum(fuzzer.refusals.values()) > CASES / 4
    after = fuzzer.generation
    wait_until(lambda: fuzzer.generation > after, "another generation")
    assert children(run_dir) == before, run.output
    assert {topic for topic in PUBLISHED if fuzzer.heard[topic] <= looked[topic]} == set()
    assert progress[-1].restarts == 0
    probe.call(Trigger, "orchestrator/stop")
    assert run.wait() == 0, run.output
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        done = len(repertoire.metrics())
    assert run_digest(run_dir) == search_digest(evaluations=10 * done)
