"""Adding and sampling 100 controllers compared with pyribs, and the latency of get_behavior during a run at full load.

Run: `.venv/bin/python bench/archive.py [--requests 500]`; the last line is JSON. Adding and sampling are measured in
turn (A B A B ...) with an archive of pyribs that has the same cells and solutions. The latency is that of a client in
this process while QDWalker runs with an evaluator per core, compared with that of a service that does nothing under
the same load (`resume` of a run that is not paused).
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from _measure import seconds, spread
from _processes import start_run, wait_for_generation
from pga_me_msgs.srv import GetBehavior
from ribs.archives import CVTArchive
from std_srvs.srv import Trigger

from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import task_spec

BATCH = 100
WARM_UP = 20
LEAD = 7
"""Generations before the latency is measured, after which PG variation and training run."""


def against_pyribs(rounds: int) -> dict[str, dict[str, float]]:
    """Compare adding a batch, and drawing 148 parents, with pyribs; ratios are its time over ours."""
    ours = make_archive(task_spec("qd_walker"), Settings())
    theirs = CVTArchive(
        solution_dim=ours.parameter_count,
        centroids=ours.centroids,
        ranges=[(0.0, 1.0)] * 2,
        solution_dtype=np.float32,
        measures_dtype=np.float64,
        objective_dtype=np.float64,
    )
    rng = np.random.default_rng(0)
    adding, sampling = [], []
    for i in range(WARM_UP + rounds):
        fitness, descriptors = rng.normal(size=BATCH), rng.random((BATCH, 2))
        parameters = rng.standard_normal((BATCH, ours.parameter_count), np.float32)
        batch = Solutions.of(
            fitness=fitness,
            descriptors=descriptors,
            parameters=parameters,
            evaluations=range(i * BATCH, (i + 1) * BATCH),
        )
        a = seconds(lambda: ours.add(batch))  # noqa: B023
        b = seconds(lambda: theirs.add(parameters, fitness, descriptors))  # noqa: B023
        c = seconds(lambda: ours.parameters[ours.sample_parents(rng, 148)])
        d = seconds(lambda: theirs.sample_elites(148))
        if i >= WARM_UP:
            adding.append(b / a)
            sampling.append(d / c)
    if ours.coverage != len(theirs):
        raise SystemExit("the two archives differ")
    return {"pyribs_over_ours_add": spread(adding), "pyribs_over_ours_sample": spread(sampling)}


def latencies(node: Any, client: Any, request: Any, count: int) -> np.ndarray:
    """Return the durations of some calls, s."""
    client.wait_for_service()
    out = []
    for _ in range(count):
        start = time.perf_counter()
        future = client.call_async(request)
        while not future.done():
            rclpy.spin_once(node, timeout_sec=1.0)
        out.append(time.perf_counter() - start)
    return np.array(out)


def under_load(requests: int) -> dict[str, float]:
    """Measure get_behavior during a run; milliseconds, and ratios to a service that does nothing."""
    with tempfile.TemporaryDirectory() as folder:
        process = start_run(folder, {"evaluations": 1_000_000})
        try:
            wait_for_generation(process, Path(folder) / "repertoire.db", LEAD - 1)
            rclpy.init()
            node = rclpy.create_node("bench")
            ask = node.create_client(GetBehavior, "repertoire/get_behavior")
            nothing = node.create_client(Trigger, "orchestrator/resume")
            wanted = GetBehavior.Request(descriptor=[0.5, 0.5])
            idle = latencies(node, nothing, Trigger.Request(), requests)
            busy = latencies(node, ask, wanted, requests)
            node.destroy_node()
            rclpy.shutdown()
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()
    return {
        "median_ms": round(1e3 * float(np.median(busy)), 2),
        "p99_ms": round(1e3 * float(np.quantile(busy, 0.99)), 2),
        "median_over_empty_service": round(float(np.median(busy) / np.median(idle)), 2),
        "p99_over_empty_service": round(
            float(np.quantile(busy, 0.99) / np.quantile(idle, 0.99)), 2
        ),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=200)
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    figures: dict[str, Any] = dict(against_pyribs(arguments.rounds))
    figures["get_behavior_under_load"] = under_load(arguments.requests)
    for name, values in figures.items():
        print(f"{name}: {values}")
    print(json.dumps({"bench": "archive", "figures": figures}))


if __name__ == "__main__":
    main()
