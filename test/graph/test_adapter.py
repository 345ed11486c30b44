"""The adapter over its services: a shipped repertoire, robots that answer well, badly, twice or never, and restarts."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domain_coordinator import domain_id
from graph import Graph, Probe, Started, wait_until
from pga_me_msgs.msg import AdaptationEstimate
from pga_me_msgs.srv import AddToArchive, GetAdaptation, NextTrial, ReportTrial, StartAdaptation
from stored import Served, served, solutions, to_add

from pga_me_ros.adapting.memory import Memory
from pga_me_ros.client import Adapter, Behavior, BlockedExecutorError
from pga_me_ros.core.adaptation.adaptation import Adaptation
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.ros import names, qos

REPERTOIRE = "zoo/qd_hopper"


@dataclass
class Adapting:
    """A repertoire that is served, an adapter, and a node that asks it."""

    graph: Graph
    probe: Probe
    memory: Path
    node: Started

    def call(self, srv_type: Any, name: str, **fields: Any) -> Any:
        return self.probe.call(srv_type, name, **fields)

    def start(self, **fields: Any) -> Any:
        return self.call(StartAdaptation, names.START_ADAPTATION, **fields)

    def next(self, **fields: Any) -> Any:
        return self.call(NextTrial, names.NEXT_TRIAL, **fields)

    def report(self, trial: int, fitness: float = 0.0, **fields: Any) -> Any:
        return self.call(
            ReportTrial, names.REPORT_TRIAL, trial=trial, fitness=float(fitness), **fields
        )

    def achieved(self) -> list[float]:
        """Return what each trial achieved, NaN for those that are open or given up."""
        trials = self.call(GetAdaptation, names.ADAPTATION_STATUS).estimate.trials
        return [trial.achieved for trial in trials]

    @contextmanager
    def full_disk(self) -> Iterator[None]:
        """Keep the adapter from writing beyond the first byte of any file, like an exhausted quota."""
        pid, free = self.node.process.pid, resource.RLIM_INFINITY
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (1, free))
        try:
            yield
        finally:
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (free, free))

    def restart(self, number: signal.Signals = signal.SIGKILL) -> None:
        self.node.signal(number)
        self.node.wait()
        self.node = self.graph.start("adapter", {"memory": self.memory})
        wait_until(self._answers, "an answer of the new adapter")

    def _answers(self) -> bool:
        """Whether the new node answers; a killed one stays visible for a while, and takes requests with it."""
        try:
            self.probe.call(GetAdaptation, names.ADAPTATION_STATUS, timeout=2.0)
        except AssertionError:
            return False
        return True


@pytest.fixture(scope="module")
def adapting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Adapting]:
    """Serve the shipped hopper and start an adapter, for all tests of this file."""
    folder = tmp_path_factory.mktemp("adapting")
    with pytest.MonkeyPatch.context() as patch, domain_id() as domain:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph = Graph(domain, folder)
        graph.start("archive_manager", {"repertoire": REPERTOIRE})
        memory = folder / "memory.db"
        node = graph.start("adapter", {"memory": memory})
        probe = Probe(domain)
        yield Adapting(graph, probe, memory, node)
        probe.close()
        graph.kill()


def robot(promised: float, descriptor: float) -> float:
    """Return what a damaged hopper achieves: nothing unless it stands more."""
    return promised if descriptor > 0.75 else 100.0


def reference(*, worlds: bool = False) -> tuple[Adaptation, list[int]]:
    """Return an adaptation without ROS, and the cells that it tried."""
    run = StoredRun.load(REPERTOIRE)
    others = run.worlds if worlds else None
    adaptation = Adaptation(PerformanceMap.of(run.choices()), worlds=others)
    while trial := adaptation.next():
        adaptation.report(robot(trial.promised, float(trial.descriptor[0])))
    return adaptation, [trial.cell for trial in adaptation.trials]


def test_the_client_adapts_by_the_trials_of_the_library(adapting: Adapting) -> None:
    expected, cells = reference()
    heard = adapting.probe.listen(AdaptationEstimate, names.ADAPTATION, qos.LATCHED)
    tried: list[int] = []

    def attempt(behavior: Behavior) -> float:
        tried.append(behavior.cell)
        assert behavior.controller(np.zeros(15, np.float32)).shape == (3,)
        return robot(behavior.promised_fitness, float(behavior.promised_descriptor[0]))

    result = Adapter(adapting.probe.node).adapt(attempt, anew=True)
    assert tried == cells
    assert (result.trials, result.adapted) == (len(cells), expected.adapted)
    best = expected.best
    assert best is not None
    assert result.behavior is not None
    assert (result.behavior.cell, result.achieved) == (best.cell, best.achieved)
    wait_until(lambda: bool(heard) and heard[-1].state == "adapted", "the last estimate")
    means, deviations = expected.estimate
    np.testing.assert_array_equal(heard[-1].expected, means)
    np.testing.assert_array_equal(heard[-1].uncertainty, deviations)
    np.testing.assert_array_equal(heard[-1].promised, expected.promises.fitness)
    assert [trial.cell for trial in heard[-1].trials] == cells
    assert heard[-1].best == best.number


def test_a_robot_that_may_be_in_other_worlds_makes_the_trials_of_the_library(
    adapting: Adapting,
) -> None:
    expected, cells = reference(worlds=True)
    assert cells != reference()[1]
    place = ("-r", "__ns:=/elsewhere")
    graph, memory = adapting.graph, adapting.graph.folder / "elsewhere.db"
    graph.start("archive_manager", {"repertoire": REPERTOIRE}, *place)
    graph.start("adapter", {"memory": memory, "worlds": REPERTOIRE}, *place)
    tried: list[int] = []

    def attempt(behavior: Behavior) -> float:
        tried.append(behavior.cell)
        return robot(behavior.promised_fitness, float(behavior.promised_descriptor[0]))

    client = Adapter(adapting.probe.node, prefix="/elsewhere")
    result = client.adapt(attempt, anew=True)
    assert tried == cells
    assert (result.trials, result.adapted) == (len(cells), expected.adapted)
    np.testing.assert_array_equal(client.status().expected, expected.estimate[0])


def test_worlds_of_another_run_or_of_none_are_refused(adapting: Adapting, hopper_run: Path) -> None:
    graph, place = adapting.graph, ("-r", "__ns:=/strange")
    none = graph.start("adapter", {"worlds": hopper_run}, *place)
    nowhere = graph.start("adapter", {"worlds": "zoo/qd_hoper"}, *place)
    graph.start("archive_manager", {"repertoire": hopper_run}, *place)
    graph.start("adapter", {"worlds": REPERTOIRE, "memory": graph.folder / "strange.db"}, *place)
    refused = adapting.call(StartAdaptation, f"/strange/{names.START_ADAPTATION}")
    assert not refused.ok
    assert "names 'zoo/qd_hopper', which is run" in refused.message
    assert none.wait() == 2
    assert "were not evaluated in another world; do so first (reevaluate" in none.output
    assert nowhere.wait() == 2
    assert "did you mean 'zoo/qd_hopper'?" in nowhere.output


def test_a_trial_is_open_until_it_is_reported_properly_and_once(adapting: Adapting) -> None:
    begun = adapting.start(anew=True)
    assert (begun.ok, begun.candidates, begun.trials) == (
        True,
        len(reference()[0].promises.cells),
        0,
    )
    first = adapting.next()
    assert (first.ok, first.over, first.trial.number) == (True, False, 1)
    again = adapting.next(with_controller=False)
    assert again.trial.cell == first.trial.cell
    assert not again.controller.layer_sizes
    for trial, fitness, words in (
        (1, float("nan"), "report a finite fitness"),
        (2, 5.0, "There is no trial 2; 1 were given out"),
        (0, 5.0, "There is no trial 0"),
    ):
        refused = adapting.report(trial, fitness)
        assert not refused.ok
        assert words in refused.message
    assert adapting.next().trial.number == 1
    assert adapting.report(1, 100.0).ok
    twice = adapting.report(1, 900.0)
    assert not twice.ok
    assert "Trial 1 is not open" in twice.message
    assert adapting.achieved() == [100.0]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_after_a_restart_it_knows_what_was_tried(
    adapting: Adapting, number: signal.Signals
) -> None:
    adapting.start(anew=True)
    first = adapting.next()
    adapting.report(1, 100.0)
    second = adapting.next()
    adapting.restart(number)
    same = adapting.next()
    assert (same.trial.number, same.trial.cell) == (2, second.trial.cell)
    assert adapting.report(2, 90.0).ok
    state = adapting.call(GetAdaptation, names.ADAPTATION_STATUS).estimate
    assert [trial.cell for trial in state.trials] == [first.trial.cell, second.trial.cell]
    assert [trial.achieved for trial in state.trials] == [100.0, 90.0]
    if state.state == "running":
        continued = adapting.start()
        assert (continued.trials, continued.message) == (2, "Continues after 2 trials.")


def test_what_is_given_up_is_not_tried_again(adapting: Adapting) -> None:
    adapting.start(anew=True)
    cell = adapting.next().trial.cell
    assert adapting.report(1, give_up=True).ok
    assert adapting.next().trial.cell != cell


def test_what_could_not_be_stored_does_not_count_and_may_be_said_again(
    adapting: Adapting,
) -> None:
    adapting.start(anew=True, budget=5)
    with adapting.full_disk():
        assert_not_stored(adapting.start(anew=True, budget=1))
        assert_not_stored(adapting.start(budget=1))
        for _ in range(2):
            assert_not_stored(adapting.next())
    assert adapting.achieved() == []
    first = adapting.next()
    with adapting.full_disk():
        assert_not_stored(adapting.report(1, 100.0))
        assert_not_stored(adapting.report(1, give_up=True))
    assert adapting.next().trial.cell == first.trial.cell
    assert adapting.report(1, 100.0).ok
    second = adapting.next()
    assert adapting.report(2, give_up=True).ok
    undertaking, trials = Memory(adapting.memory).last() or pytest.fail("nothing was stored")
    assert undertaking.budget == 5
    assert [t.cell for t in trials] == [first.trial.cell, second.trial.cell]
    assert [(t.achieved, t.given_up) for t in trials] == [(100.0, False), (None, True)]


def assert_not_stored(response: Any) -> None:
    assert not response.ok
    assert "cannot be written" in response.message


def test_an_adaptation_is_not_continued_with_other_limits(adapting: Adapting) -> None:
    adapting.start(anew=True, min_fitness=500.0)
    cell = adapting.next().trial.cell
    refused = adapting.start(max_fall_share=0.5)
    assert not refused.ok
    assert "min_fitness 500 is under way, but max_fall_share 0.5 is asked for" in refused.message
    assert adapting.start(min_fitness=500.0).message == "Continues after 1 trials."
    assert adapting.next().trial.cell == cell


def test_it_goes_on_while_the_repertoire_grows(tmp_path: Path) -> None:
    with served(tmp_path, generations=1, grow=True) as repertoire:
        memory = tmp_path / "memory.db"
        node = repertoire.graph.start("adapter", {"memory": memory})
        adapting = Adapting(repertoire.graph, repertoire.probe, memory, node)
        assert adapting.start().candidates == repertoire.archive.coverage
        reported = adapting.next().trial
        grow(repertoire, 1, reported)
        # The robot had the behavior before another took its cell, so what it achieved counts.
        assert adapting.report(1, reported.promised).ok
        replaced = adapting.next().trial
        assert (replaced.evaluation, replaced.promised) == (fittest(repertoire), 2000.0)
        assert adapting.start().candidates == repertoire.archive.coverage
        grow(repertoire, 2, replaced)
        given = adapting.next()
        assert given.ok, given.message
        assert (given.trial.number, given.trial.promised) == (3, 3000.0)
        evaluation, cell = fittest(repertoire), given.trial.cell
        assert (given.trial.evaluation, given.behavior.evaluation) == (evaluation, evaluation)
        parameters = np.array(given.controller.parameters, np.float32)
        np.testing.assert_array_equal(parameters, repertoire.archive.parameters[cell])
        estimate = adapting.call(GetAdaptation, names.ADAPTATION_STATUS).estimate
        assert list(estimate.cells) == np.flatnonzero(repertoire.archive.filled).tolist()
        assert [trial.given_up for trial in estimate.trials] == [False, True, False]


def grow(repertoire: Served, generation: int, trial: Any) -> None:
    """Add a generation, one of which takes the cell of a trial, and the others any."""
    batch = solutions(generation)
    batch.fitness[0], batch.descriptors[0] = 1000.0 * (generation + 1), trial.descriptor
    answer = repertoire.probe.call(AddToArchive, "archive/add", **to_add(generation, batch))
    assert answer.accepted, answer.message
    repertoire.archive.add(batch)


def fittest(repertoire: Served) -> int:
    archive = repertoire.archive
    return int(archive.evaluations[np.nanargmax(archive.fitness)])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"budget": 0}, "budget is 0; give at least 1 trial"),
        ({"budget": -7}, "budget is -7"),
        ({"min_fitness": 1e6}, "No behavior of the repertoire meets min_fitness 1e+06"),
        ({"max_fall_share": 2.0}, "share"),
    ],
)
def test_a_start_that_makes_no_sense_changes_nothing(
    adapting: Adapting, fields: dict[str, Any], words: str
) -> None:
    adapting.start(anew=True)
    adapting.next()
    refused = adapting.start(anew=True, **fields)
    assert not refused.ok
    assert words in refused.message
    assert adapting.next().trial.number == 1


def test_the_client_says_what_is_wrong(adapting: Adapting) -> None:
    with pytest.raises(RequestError, match="budget is 0; give at least 1 trial"):
        Adapter(adapting.probe.node).adapt(lambda _: 0.0, budget=0)
    nobody = Adapter(adapting.probe.node, prefix="/nobody", timeout=0.3)
    with pytest.raises(PgaError, match="start an adapter"):
        nobody.adapt(lambda _: 0.0)


def test_a_memory_is_that_of_one_robot(adapting: Adapting) -> None:
    other = adapting.graph.start("adapter", {"memory": adapting.memory}, "-r", "__ns:=/right")
    assert other.wait() == 2
    pid = adapting.node.process.pid
    assert f"memory.db' is that of another adapter that runs (pid {pid} on " in other.output
    assert "-p memory:=FILE" in other.output


def test_a_blocking_call_in_a_callback_is_not_sent(adapting: Adapting) -> None:
    adapting.start(anew=True)
    before, _ = Memory(adapting.memory).last() or pytest.fail("nothing was stored")
    errors: list[str] = []

    def adapt() -> None:
        timer.cancel()
        with pytest.raises(BlockedExecutorError) as error:
            Adapter(adapting.probe.node).adapt(lambda _: 0.0, anew=True)
        errors.append(str(error.value))

    timer = adapting.probe.node.create_timer(0.01, adapt)
    wait_until(lambda: bool(errors), "the error")
    assert adapting.next().trial.number == 1  # what it asked for would have come before
    after, _ = Memory(adapting.memory).last() or pytest.fail("nothing was stored")
    assert after == before


def test_a_second_adapter_of_the_name_leaves_and_one_without_a_repertoire_says_so(
    adapting: Adapting,
) -> None:
    another = adapting.graph.folder / "another.db"
    second = adapting.graph.start("adapter", {"memory": another})
    alone = adapting.graph.start(
        "adapter", {"memory": adapting.graph.folder / "other.db"}, "-r", "__ns:=/alone"
    )
    assert second.wait() == 2
    assert "is taken in this ROS domain" in second.output
    begun = time.monotonic()
    refused = adapting.call(StartAdaptation, f"/alone/{names.START_ADAPTATION}")
    assert not refused.ok
    assert "start the orchestrator or an archive_manager" in refused.message
    assert time.monotonic() - begun < 30.0
    unasked = adapting.call(NextTrial, f"/alone/{names.NEXT_TRIAL}")
    assert "No adaptation was started; call adapt/start" in unasked.message
    assert alone.process.poll() is None
