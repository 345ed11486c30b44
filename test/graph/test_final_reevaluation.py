"""The end of a run: its elites are re-evaluated by its evaluators, which changes nothing about the repertoire."""

from __future__ import annotations

import csv
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domain_coordinator import domain_id
from graph import NOT_ALONE, Graph, Probe, Started, wait_until
from pga_me_msgs.msg import Metrics, Progress
from pga_me_msgs.srv import GetBehavior, GetInfo
from reference import evaluations_of, run_digest, search_digest

from pga_me_ros.core.evaluation import reevaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.storage.reevaluations import FILE, Reevaluations
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.ros import names, qos
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import rollout

REPEATS = 3
MANY = 400
"""More than anybody would wait for."""


@dataclass
class Run:
    """A run that was stopped in the middle of its re-evaluations, and then finished."""

    folder: Path
    interrupted: Started
    finished: Started
    left: int = 0
    progress: list[Progress] = field(default_factory=list)
    metrics: list[Metrics] = field(default_factory=list)
    best: Any = None
    growing: bool = True


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    folder = tmp_path_factory.mktemp("final")
    run_dir = folder / "run"
    with domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph, probe = Graph(domain, folder), Probe(domain)
        try:
            heard = probe.listen(Progress, names.PROGRESS, qos.CLAIMS)
            interrupted = graph.run(run_dir, reevaluations=MANY)

            def under_way() -> bool:
                assert interrupted.process.poll() is None, interrupted.output
                return any(m.state == "re-evaluating" and m.final_reevaluations for m in heard)

            wait_until(under_way, "the first re-evaluations")
            growing = _is_growing(probe)
            interrupted.signal(signal.SIGINT)
            interrupted.wait()
            left = len(rows_of(run_dir).fitness)
            heard.clear()
            metrics = probe.listen(Metrics, names.METRICS, qos.LATCHED)
            finished = graph.run(run_dir, reevaluations=REPEATS, serve=True, **NOT_ALONE)
            finished.wait_for_output("serving it as")
            wait_until(lambda: any(m.corrected_repeats for m in metrics), "the corrected measures")
            best = probe.call(GetBehavior, names.GET_BEHAVIOR, select=GetBehavior.Request.BEST)
            finished.signal(signal.SIGINT)
            finished.wait()
            yield Run(run_dir, interrupted, finished, left, heard, metrics, best, growing)
        finally:
            probe.close()
            graph.kill()


def _is_growing(probe: Probe) -> bool:
    """Return what get_info says, after it had time to hear of the run's state."""
    return all(probe.call(GetInfo, names.GET_INFO).growing for _ in range(20))


def test_a_repertoire_no_longer_grows_while_it_is_reevaluated(run: Run) -> None:
    assert not run.growing


def rows_of(run_dir: Path) -> Reevaluations:
    stored = StoredRun.load(run_dir)
    return Reevaluations.load(stored.file, stored.info.run_id, stored.spec.descriptor_dim)


def test_the_repertoire_is_the_same_as_without(run: Run) -> None:
    assert run_digest(run.folder) == search_digest()
    assert evaluations_of(run.folder) == 30
    assert {m.evaluations for m in run.progress if m.state == "finished"} == {30}


def test_what_was_done_before_a_stop_is_kept_and_the_rest_is_done(run: Run) -> None:
    assert run.interrupted.process.returncode == 0
    assert "the same command resumes" in run.interrupted.output
    stored = StoredRun.load(run.folder)
    elites = stored.archive.coverage
    assert 0 < run.left < MANY * elites
    again = stored.reevaluations
    pairs = list(zip(again.evaluation.tolist(), again.repeat.tolist(), strict=True))
    assert len(pairs) == len(set(pairs)), "something was done twice"
    wanted = {
        (int(stored.archive.evaluations[cell]), repeat)
        for cell in stored.archive.filled_cells()
        for repeat in range(REPEATS)
    }
    assert wanted <= set(pairs)
    assert len(pairs) <= run.left + len(wanted)


def test_each_outcome_is_what_the_controller_does_from_the_pose_of_its_repeat(run: Run) -> None:
    stored = StoredRun.load(run.folder)
    rows, archive = stored.reevaluations, stored.archive
    task = make_task(stored.settings.task)
    for row in range(0, len(rows.fitness), max(1, len(rows.fitness) // 20)):
        (cell,) = np.flatnonzero(archive.evaluations == rows.evaluation[row])
        controller = MlpController(stored.shape, archive.parameters[cell])
        rng = reevaluation_rng(stored.settings.seed, int(rows.repeat[row]))
        episode = rollout(task, controller, rng)
        assert (rows.fitness[row], rows.steps[row]) == (episode.fitness, episode.length)
        assert rows.descriptor[row].tobytes() == episode.descriptor.tobytes()
        assert rows.terminated[row] == episode.terminated
    task.close()


def test_progress_counts_them_apart(run: Run) -> None:
    stored = StoredRun.load(run.folder)
    states = list(dict.fromkeys(m.state for m in run.progress))
    assert states == ["starting", "re-evaluating", "finished"]
    last = run.progress[-1]
    assert last.budget == 30
    assert last.final_reevaluations == last.final_budget <= REPEATS * stored.archive.coverage
    assert f"evaluates its {stored.archive.coverage} elites again" in run.finished.output


def test_the_corrected_measures_are_published_and_in_the_table(run: Run) -> None:
    corrected = StoredRun.load(run.folder).corrected
    assert corrected is not None
    known = [m for m in run.metrics if m.corrected_repeats]
    assert {m.generation for m in known} == {2}
    assert known[-1].corrected_coverage == corrected.coverage
    assert known[-1].corrected_qd_score == corrected.qd_score
    assert known[-1].corrected_fall_share == corrected.fall_share
    with (run.folder / "metrics.csv").open() as file:
        *before, last = list(csv.DictReader(file))
    assert float(last["corrected_qd_score"]) == corrected.qd_score
    assert int(last["corrected_reevaluations"]) == corrected.reevaluations
    assert {row["corrected_qd_score"] for row in before} == {""}
    assert f"corrected archive: coverage {corrected.coverage} (not" in run.finished.output


def test_a_behavior_is_served_with_its_means_and_chosen_by_them(run: Run) -> None:
    stored = StoredRun.load(run.folder)
    behavior = run.best.behavior
    assert (behavior.by_mean, behavior.repeats >= REPEATS) == (True, True)
    assert behavior.mean_fitness == np.nanmax(stored.statistics.mean_fitness)
    assert behavior.fall_share == stored.statistics.fall_share[behavior.cell]


def test_a_run_that_has_them_starts_no_evaluators(run: Run) -> None:
    with domain_id() as domain:
        graph = Graph(domain, run.folder.parent)
        content = (run.folder / FILE).read_bytes()
        again = graph.run(run.folder, reevaluations=REPEATS)
        try:
            assert again.wait() == 0, again.output
        finally:
            graph.kill()
        assert "elites again" not in again.output
        assert "corrected archive: coverage" in again.output
        assert (run.folder / FILE).read_bytes() == content


def test_a_file_that_cannot_be_used_is_told_and_the_run_is_finished(
    run: Run, tmp_path: Path
) -> None:
    (run.folder / FILE).write_text("no arrays")
    with domain_id() as domain:
        graph = Graph(domain, tmp_path)
        again = graph.run(run.folder, reevaluations=REPEATS)
        try:
            assert again.wait() == 0, again.output
        finally:
            graph.kill()
    assert "warning: not all elites were re-evaluated: " in again.output
    assert "is damaged or no file of re-evaluations" in again.output
    assert f"finished: {run.folder / REPERTOIRE}" in again.output
