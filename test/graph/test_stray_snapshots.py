"""A foreign node that knows a run's id publishes snapshots of another algorithm, which change nothing."""

from __future__ import annotations

import threading
from itertools import cycle
from pathlib import Path

from fuzz_targets import World, snapshot_target
from graph import Graph, Probe, wait_until
from pga_me_msgs.msg import CriticSnapshot, Metrics, Progress
from reference import run_digest, run_settings, search_digest

from pga_me_ros.ros import names, qos
from pga_me_ros.tasks.registry import task_spec

EVALUATIONS = 80


def test_a_snapshot_of_another_algorithm_is_dropped_by_all_nodes(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    progress = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    metrics = probe.listen(Metrics, names.METRICS, qos.LATCHED)
    stray = probe.node.create_publisher(CriticSnapshot, names.SNAPSHOT, qos.LATCHED)
    run = graph.run(tmp_path / "run", evaluations=EVALUATIONS)
    wait_until(lambda: any(p.run_id for p in progress), "the run's id")
    settings = run_settings()
    world = World(progress[-1].run_id, task_spec(settings.task), settings, "", (), "", ())
    sound = snapshot_target(world).sound
    pause = threading.Event()
    for ahead in cycle((1, 2)):  # snapshots that are needed next, or already ordered
        if run.process.poll() is not None:
            break
        generation = max((m.generation for m in metrics), default=-1) + ahead
        foreign = {"generation": generation, "networks": ["diversity_critic", "greedy"]}
        stray.publish(CriticSnapshot(**{**sound, **foreign}))
        pause.wait(0.01)
    assert run.wait() == 0, run.output
    words = "dropped a critic snapshot: it has no network 'critic'; pga_map_elites needs one"
    assert words in run.output
    assert run_digest(tmp_path / "run") == search_digest(evaluations=EVALUATIONS)
