"""A small repertoire file of real evaluations, made in this process for tests of serving."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domain_coordinator import domain_id
from graph import Graph, Probe, Started, wait_until
from pga_me_msgs.srv import GetInfo

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.metrics import generation_metrics
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import random_parameters
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.ros.convert import flat, rates_to_msg
from pga_me_ros.tasks.registry import load_task, task_spec
from pga_me_ros.tasks.rollout import Episode, rollout

RUN_ID = "run-of-the-tests"
B = 10
SETTINGS = Settings(
    task="qd_walker",
    seed=3,
    evaluations=2 * B,
    random_init=B,
    batch_size=B,
    n_evo=5,
    cells=64,
    cvt_samples=2000,
    controller_hidden=(16, 16),
)
SPEC = task_spec("qd_walker")
SHAPE = controller_shape(SPEC, SETTINGS)


def parameters(generation: int) -> np.ndarray:
    """Return the (B, P) controllers of a generation."""
    rng = np.random.default_rng(generation)
    return np.stack([random_parameters(SHAPE, rng) for _ in range(B)])


@cache
def episodes(generation: int) -> tuple[Episode, ...]:
    """Return the evaluations of a generation."""
    task = load_task("qd_walker")()
    ids = range(B * generation, B * generation + B)
    out = [
        rollout(task, MlpController(SHAPE, p), evaluation_rng(SETTINGS.seed, k))
        for k, p in zip(ids, parameters(generation), strict=True)
    ]
    task.close()
    return tuple(out)


def solutions(generation: int) -> Solutions:
    """Return a generation in the form that the archive takes."""
    done = episodes(generation)
    return Solutions.of(
        fitness=[e.fitness for e in done],
        descriptors=[e.descriptor for e in done],
        parameters=parameters(generation),
        evaluations=range(B * generation, B * generation + B),
        generation=generation,
        steps=[e.length for e in done],
        terminated=[e.terminated for e in done],
    )


def to_add(generation: int, batch: Solutions) -> dict[str, Any]:
    """Return the fields of the request that adds a generation to a repertoire that is served to grow."""
    return {
        "run_id": RUN_ID,
        "generation": generation,
        "operators": batch.operators.tolist(),
        "parents": flat(batch.parents, "q"),
        "fitness": flat(batch.fitness, "d"),
        "descriptors": flat(batch.descriptors, "d"),
        "steps": flat(batch.steps, "q"),
        "terminated": batch.terminated.tolist(),
        "parameters": flat(batch.parameters, "f"),
        "rates": rates_to_msg(SETTINGS),
    }


def store(path: Path, generations: int = 2) -> Archive:
    """Write a repertoire file and return its archive."""
    info = RunInfo(
        run_id=RUN_ID,
        settings=SETTINGS.to_dict(),
        task=SPEC.to_json(),
        layer_sizes=SHAPE.sizes,
        activations=("relu", "relu", "tanh"),
        versions={"numpy": np.__version__},
        created="2026-01-01T00:00:00+00:00",
    )
    archive = make_archive(SPEC, SETTINGS)
    with Repertoire.create(path, info, archive) as file:
        before = None
        for t in range(generations):
            added = archive.add(solutions(t))
            before = generation_metrics(archive, solutions(t), added, t, before)
            elites = [archive.elite(cell) for cell in added.changed_cells.tolist()]
            file.commit(t, elites, before, {})
    return archive


@dataclass
class Served:
    """A stored repertoire, the node that serves it, and a node to call it with."""

    path: Path
    archive: Archive
    graph: Graph
    manager: Started
    probe: Probe


@contextmanager
def served(folder: Path, generations: int = 2, *, grow: bool = False) -> Iterator[Served]:
    """Serve a repertoire with only an archive manager, in a private ROS domain."""
    path = folder / "repertoire.db"
    archive = store(path, generations)
    with domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph = Graph(domain, folder)
        probe = Probe(domain)
        try:
            manager = graph.start("archive_manager", {"repertoire": path, "grow": grow})
            client = probe.node.create_client(GetInfo, "repertoire/get_info")

            def ready() -> bool:
                assert manager.process.poll() is None, manager.output
                return client.service_is_ready()

            wait_until(ready, "the archive manager")
            yield Served(path, archive, graph, manager, probe)
        finally:
            probe.close()
            graph.kill()
