"""A run of the whole graph from start to end."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from domain_coordinator import domain_id
from graph import NOT_ALONE, Graph, Probe, Started, wait_until
from pga_me_msgs.msg import Progress
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.ros import names, qos


@dataclass
class Finished:
    """A run that has ended, and what it published about its progress."""

    run_dir: Path
    run: Started
    heard: list[Progress]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Finished]:
    folder = tmp_path_factory.mktemp("finished")
    with domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph, probe = Graph(domain, folder), Probe(domain)
        try:
            heard = probe.listen(Progress, names.PROGRESS, qos.EXPERIENCE_READER)
            renamed = ("-r", "archive/add:=archive/insert")
            run = graph.run(folder / "run", *renamed, tensorboard=True, **NOT_ALONE)
            assert run.wait() == 0, run.output
            yield Finished(folder / "run", run, heard)
        finally:
            probe.close()
            graph.kill()


def test_a_renamed_service_is_renamed_for_all_nodes(finished: Finished) -> None:
    assert "archive/add:=archive/insert" in finished.run.process.args
    assert finished.run.process.returncode == 0


def test_a_run_ends_with_a_repertoire_of_its_budget(finished: Finished) -> None:
    with Repertoire.open(finished.run_dir / "repertoire.db", read_only=True) as repertoire:
        metrics = repertoire.metrics()
    assert [m.evaluations for m in metrics] == [10, 20, 30]
    made = dict(zip(Operator, metrics[-1].offspring, strict=True))
    assert +Counter(made) == {Operator.GA: 5, Operator.PG: 4, Operator.GREEDY: 1}


def test_the_topic_of_progress_has_its_states_and_numbers(finished: Finished) -> None:
    heard, run = finished.heard, finished.run
    wait_until(lambda: bool(heard) and heard[-1].state == "finished", "the last state")
    assert list(dict.fromkeys(m.state for m in heard)) == ["starting", "running", "finished"]
    assert heard[0].evaluations == 0
    assert math.isnan(heard[0].max_fitness)
    counts = [m.evaluations for m in heard]
    assert counts == sorted(counts)
    last = heard[-1]
    assert (last.task, last.pid) == ("qd_walker", run.process.pid)
    assert (last.generation, last.generations) == (2, 3)
    assert (last.evaluations, last.budget, last.cells) == (30, 30, 64)
    assert 0 < last.coverage <= 30
    assert last.rate > 0
    assert last.eta == 0
    assert {m.evaluators for m in heard if m.state == "running"} == {1}


def test_in_a_file_every_generation_has_a_line(finished: Finished) -> None:
    run = finished.run
    assert "\x1b" not in run.output
    lines = [line for line in run.output.splitlines() if "generation" in line]
    assert [line.rsplit("  ", 1)[1] for line in lines] == [
        "generation 1/3",
        "generation 2/3",
        "generation 3/3",
    ]


def test_tensorboard_shows_every_generation(finished: Finished) -> None:
    events = EventAccumulator(str(finished.run_dir)).Reload()
    assert [event.step for event in events.Scalars("archive/qd_score")] == [10, 20, 30]
