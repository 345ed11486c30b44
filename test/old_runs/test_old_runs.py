"""Runs made by an earlier version are served, resumed, reported, exported and re-evaluated."""

from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from contents import (
    elites_of,
    generations_of,
    machine_digest,
    result_digest,
    run_info_of,
)
from domain_coordinator import domain_id

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "graph"))

from graph import Graph, Probe, Started, wait_until
from pga_me_msgs.srv import GetInfo

from pga_me_ros.client import RepertoireClient
from pga_me_ros.export.__main__ import main as export
from pga_me_ros.reevaluate.__main__ import main as reevaluate
from pga_me_ros.report.__main__ import main as report

HERE = Path(__file__).parent
RUNS = {
    file.parent / name: values
    for file in sorted(HERE.glob("*/runs.json"))
    for name, values in json.loads(file.read_text())["runs"].items()
}
REPEATS = 3


@dataclass
class Old:
    """A copy of an old run.

    Attributes:
        stored: The run in the source tree.
        path: The copy.
        parameters: Parameters with which the orchestrator was started.
        evaluations: Its budget, which it has used up.
        resumed_evaluations: Budget to resume it with.
        digest: Digest of its content.
        resumed_digest: Digest of its content after its own version resumed it.
    """

    stored: Path
    path: Path
    parameters: dict[str, Any]
    evaluations: int
    resumed_evaluations: int
    digest: str
    resumed_digest: str


@pytest.fixture(scope="module")
def orchestrators(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[dict[Path, tuple[Path, Started]]]:
    """Resume copies of all runs at once, each in its own ROS domain, while other tests run."""
    with ExitStack() as stack:
        started = {}
        for stored, values in RUNS.items():
            run = tmp_path_factory.mktemp("resumed") / stored.name
            shutil.copytree(stored, run)
            graph = Graph(stack.enter_context(domain_id()), run.parent)
            stack.callback(graph.kill)
            budget = {"evaluations": values["resumed_evaluations"], "run_dir": run}
            given = {**values["parameters"], **budget, "discovery_wait": 0.0}
            orchestrator = graph.start("orchestrator", given)
            started[stored] = run, orchestrator
        yield started


@pytest.fixture(
    scope="module", params=list(RUNS), ids=lambda path: f"{path.parent.name}-{path.name}"
)
def old(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    orchestrators: dict[Path, tuple[Path, Started]],  # started first, because they take longest
) -> Old:
    copied = tmp_path_factory.mktemp("old") / request.param.name
    shutil.copytree(request.param, copied)
    return Old(request.param, copied, **RUNS[request.param])


@pytest.fixture(scope="module")
def resumed(old: Old, orchestrators: dict[Path, tuple[Path, Started]]) -> Path:
    """Return a copy that was resumed with a higher budget."""
    run, orchestrator = orchestrators[old.stored]
    assert orchestrator.wait() == 0, orchestrator.output
    assert "missing" not in orchestrator.output
    assert "damaged" not in orchestrator.output
    return run


@pytest.fixture
def client(old: Old, monkeypatch: pytest.MonkeyPatch) -> Iterator[RepertoireClient]:
    """Return a client of an archive manager that serves the run."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with domain_id() as domain:
        graph, probe = Graph(domain, old.path.parent), Probe(domain)
        try:
            manager = graph.start("archive_manager", {"repertoire": old.path / "repertoire.db"})
            service = probe.node.create_client(GetInfo, "repertoire/get_info")

            def ready() -> bool:
                assert manager.process.poll() is None, manager.output
                return service.service_is_ready()

            wait_until(ready, "the archive manager")
            yield RepertoireClient(probe.node, timeout=60.0)
        finally:
            probe.close()
            graph.kill()


def test_its_content_is_unchanged(old: Old) -> None:
    assert result_digest(old.path) == old.digest
    assert generations_of(old.path)[-1]["evaluations"] == old.evaluations


def test_it_is_served(old: Old, client: RepertoireClient) -> None:
    stored = run_info_of(old.path)
    elites = {elite["cell"]: elite for elite in elites_of(old.path)}
    info = client.get_info()
    assert (info.run_id, info.task) == (stored["run_id"], stored["task"]["name"])
    assert (info.evaluations, info.coverage) == (old.evaluations, len(elites))
    assert info.settings == stored["settings"]
    listed = list(client.list_behaviors())
    assert sorted(behavior.cell for behavior in listed) == sorted(elites)
    for behavior in listed:
        elite = elites[behavior.cell]
        for name in ("fitness", "evaluation", "generation", "steps", "terminated"):
            assert getattr(behavior, name) == elite[name]
        assert behavior.parents == tuple(p for p in (elite["parent1"], elite["parent2"]) if p >= 0)
        np.testing.assert_array_equal(behavior.descriptor, elite["descriptor"])
    best = client.get_behavior(best=True, single=True)
    assert best.fitness == max(elite["fitness"] for elite in elites.values())
    np.testing.assert_array_equal(best.controller.parameters, elites[best.cell]["parameters"])
    if (old.path / "reevaluations.npz").exists():
        assert info.corrected_repeats == 0, "only some of its elites were re-evaluated"
        by_mean = client.get_behavior(best=True, by_mean=True)
        assert (by_mean.by_mean, 0.0 <= by_mean.fall_share <= 1.0) == (True, True)
        assert by_mean.mean_fitness == pytest.approx(mean_fitness(old.stored)[by_mean.evaluation])
        return
    # What is not known is said to be unknown.
    assert {behavior.repeats for behavior in listed} == {0}
    assert not any(behavior.by_mean for behavior in listed)
    assert all(math.isnan(behavior.fall_share) for behavior in listed)
    assert (info.corrected_repeats, math.isnan(info.corrected_qd_score)) == (0, True)


def test_it_is_resumed(old: Old, resumed: Path) -> None:
    before, after = generations_of(old.path), generations_of(resumed)
    assert after[-1]["evaluations"] == old.resumed_evaluations
    assert after[: len(before)] == before


def test_a_resumed_run_ends_as_in_its_own_version(old: Old, resumed: Path) -> None:
    made_by = json.loads((old.stored.parent / "runs.json").read_text())
    if machine_digest() != made_by["machine_digest"]:
        pytest.skip("the runs were made with a machine or libraries that compute other bits")
    assert result_digest(resumed) == old.resumed_digest


def test_it_is_reported(
    old: Old,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["report", str(old.path), "--out", str(tmp_path)])
    assert report() == 0
    last, task = generations_of(old.path)[-1], old.parameters["task"]
    numbers = [last[n] for n in ("evaluations", "coverage", "qd_score", "max_fitness")]
    algorithm = old.parameters.get("algorithm", "pga_map_elites")
    row = " | ".join([task, algorithm, "1", *(f"{number:,.0f}" for number in numbers)])
    assert f"| {row} |" in capsys.readouterr().out
    pictures = sorted(file.stem.rpartition("-")[2] for file in tmp_path.glob("*.png"))
    assert pictures == ["archive", "curves", "lineage"]


def test_it_is_exported(old: Old, tmp_path: Path) -> None:
    file = tmp_path / "elites.npz"
    assert export([str(old.path), "--to", "npz", "--out", str(file)]) == 0
    elites = elites_of(old.path)
    with np.load(file) as arrays:
        for name in ("cell", "fitness", "evaluation", "descriptor", "parameters"):
            np.testing.assert_array_equal(arrays[name], [elite[name] for elite in elites])
        parents = [[elite["parent1"], elite["parent2"]] for elite in elites]
        np.testing.assert_array_equal(arrays["parents"], parents)
        assert arrays["layer_sizes"].tolist() == run_info_of(old.path)["layer_sizes"]
        if (old.stored / "reevaluations.npz").exists():
            assert arrays["repeats"].any()


def test_further_reevaluations_are_added(old: Old, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(old.stored, run)
    command = [str(run), "--best", "3", "--repeats", str(REPEATS), "--processes", "1"]
    assert reevaluate(command) == 0
    rows = reevaluations(run)
    best = sorted(elites_of(run), key=lambda elite: -elite["fitness"])[:3]
    wanted = {(elite["evaluation"], repeat) for elite in best for repeat in range(REPEATS)}
    assert {*zip(rows["evaluation"].tolist(), rows["repeat"].tolist(), strict=True)} == wanted
    for name, values in reevaluations(old.stored).items():
        np.testing.assert_array_equal(rows[name][: len(values)], values)


def reevaluations(run: Path) -> dict[str, np.ndarray]:
    """Return the columns of a run's re-evaluations, empty if there are none."""
    file = run / "reevaluations.npz"
    if not file.exists():
        return {}
    with np.load(file) as arrays:
        names = ("evaluation", "repeat", "fitness", "descriptor", "steps", "terminated")
        return {name: arrays[name] for name in names}


def mean_fitness(run: Path) -> dict[int, float]:
    """Return the mean of a run's re-evaluations by the evaluation id of the elite."""
    rows = reevaluations(run)
    ids = np.unique(rows["evaluation"]).tolist()
    return {i: float(rows["fitness"][rows["evaluation"] == i].mean()) for i in ids}
