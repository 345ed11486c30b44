"""Experience on its way from evaluators to the critics, and evaluators that come and go."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph import Graph, Probe, wait_until
from pga_me_msgs.msg import NodeStatus, Progress, Transitions
from pga_me_msgs.srv import Evaluate, StoreExperience
from processes import children, kill_child
from reference import run_digest, search_digest

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.variation.random_controllers import random_controllers
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import episode_to_msg, flat
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import Episode, rollout

SETTINGS = Settings(
    random_init=10,
    batch_size=10,
    n_evo=5,
    controller_hidden=(16, 16),
    critic_hidden=(16, 16),
    cells=64,
)
"""Settings of the trainer that the tests call themselves."""


@pytest.fixture(scope="module")
def walker() -> Iterator[Task]:
    task = load_task("qd_walker")()
    yield task
    task.close()


@pytest.fixture(scope="module")
def episodes(walker: Task) -> list[Episode]:
    """Return the first generation's episodes, as an evaluator must simulate them."""
    shape = controller_shape(walker.spec, SETTINGS)
    parameters = random_controllers(SETTINGS, shape, 0, 0, SETTINGS.batch_size)
    return [
        rollout(walker, MlpController(shape, p), evaluation_rng(SETTINGS.seed, k))
        for k, p in enumerate(parameters)
    ]


def test_a_foreign_subscriber_receives_the_experience(
    graph: Graph, probe: Probe, walker: Task, episodes: list[Episode]
) -> None:
    heard = probe.listen(Transitions, names.TRANSITIONS, qos.EXPERIENCE_READER)
    graph.start("evaluator", {"task": "qd_walker"}, "-r", "__node:=mine")
    shape = controller_shape(walker.spec, SETTINGS)
    parameters = random_controllers(SETTINGS, shape, 0, 0, 3)
    response = probe.call(
        Evaluate,
        "mine/evaluate",
        run_id="a run",
        task="qd_walker",
        seed=SETTINGS.seed,
        evaluations=[0, 1, 2],
        layer_sizes=list(shape.sizes),
        parameters=flat(parameters, "f"),
    )
    assert response.accepted, response.message
    wait_until(lambda: len(heard) == 3, "three episodes")
    for msg, episode in zip(heard, episodes, strict=False):
        steps = episode.length
        assert (msg.run_id, msg.task, msg.evaluator) == ("a run", "qd_walker", "/mine")
        assert (msg.steps, msg.terminated) == (steps, episode.terminated)
        assert msg.fitness == episode.fitness
        states = np.reshape(msg.states, (steps + 1, msg.observation_dim))
        np.testing.assert_array_equal(states, episode.states)
        actions = np.reshape(msg.actions, (steps, msg.action_dim))
        np.testing.assert_array_equal(actions, episode.actions)
        np.testing.assert_array_equal(msg.rewards, episode.rewards)
        np.testing.assert_array_equal(msg.descriptor, episode.descriptor)


def test_the_trainer_names_missing_episodes_and_drops_duplicates(
    graph: Graph, probe: Probe, tmp_path: Path, episodes: list[Episode]
) -> None:
    run = {"run_id": "a run", "run_dir": tmp_path}
    values = {n: v for n, v in SETTINGS.to_dict().items() if v != getattr(Settings(), n)}
    graph.start("critic_trainer", {**values, **run})
    writer = probe.node.create_publisher(Transitions, names.TRANSITIONS, qos.EXPERIENCE_WRITER)

    def publish(evaluation: int, episode: Episode, run_id: str = "a run") -> None:
        msg = episode_to_msg(
            episode,
            run_id=run_id,
            task="qd_walker",
            evaluator="/probe",
            generation=0,
            evaluation=evaluation,
        )
        writer.publish(msg)

    def store() -> Any:
        return probe.call(
            StoreExperience,
            names.STORE_EXPERIENCE,
            run_id="a run",
            generation=0,
            fitness=[e.fitness for e in episodes],
        )

    assert list(store().missing) == list(range(10))
    wait_until(lambda: writer.get_subscription_count() > 0, "the trainer's subscription")
    for k in (9, 0, 3, 4, 5, 6, 7, 8):
        publish(k, episodes[k])
    publish(0, episodes[1])  # too late to count
    publish(1, episodes[1], "another run")
    wait_until(lambda: list(store().missing) == [1, 2], "all but two")
    publish(2, episodes[2])
    publish(1, episodes[1])
    wait_until(lambda: store().accepted, "a complete generation")
    stored = Experience(tmp_path / "experience", SETTINGS).episodes(0)
    assert [e.fitness for e in stored] == [e.fitness for e in episodes]


def test_a_trainer_that_stalls_misses_nothing(graph: Graph, probe: Probe, tmp_path: Path) -> None:
    heard = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    run_dir, parameters = tmp_path / "run", {"evaluations": 60}
    run = graph.run(run_dir, **parameters)
    run.wait_for_output("generation 2/")
    trainer = children(run_dir)["critic_trainer"]
    os.kill(trainer, signal.SIGSTOP)
    beats = len(heard)
    wait_until(lambda: len(heard) > beats + 3, "seconds of a run that stands still")
    assert heard[-1].generation < 5
    os.kill(trainer, signal.SIGCONT)
    assert run.wait() == 0, run.output
    assert heard[-1].restarts == 0
    assert run_digest(run_dir) == search_digest(**parameters)


def test_a_trainer_that_joins_late_gets_the_experience_it_missed(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    heard = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    episodes = probe.listen(Transitions, names.TRANSITIONS, qos.EXPERIENCE_READER)
    # The PG offspring of a generation are made in two requests, each of which takes a while.
    run_dir = tmp_path / "run"
    parameters = {"evaluations": 300, "batch_size": 100, "n_evo": 50, "n_grad": 60}
    run = graph.run(run_dir, **parameters)

    def published(generation: int) -> set[int]:
        return {msg.evaluation for msg in episodes if msg.generation == generation}

    # A restarted trainer forgets what has arrived of the current generation. It has trained for it: places from 50 are
    # those of PG offspring.
    wait_until(lambda: max(published(1), default=0) >= 150, "PG offspring of the second generation")
    kill_child(run_dir, "critic_trainer")
    late = children(run_dir)["critic_trainer"]
    os.kill(late, signal.SIGSTOP)
    wait_until(lambda: len(published(1)) == 100, "all experience of the generation")
    os.kill(late, signal.SIGCONT)
    assert run.wait() == 0, run.output
    assert heard[-1].reevaluations > 0
    assert run_digest(run_dir) == search_digest(**parameters)


@pytest.mark.parametrize("system", [{}, {"algorithm": "td3"}], ids=["pga", "td3"])
def test_episodes_lost_on_a_bad_link_are_repeated_and_duplicates_dropped(
    graph: Graph, probe: Probe, tmp_path: Path, system: dict[str, object]
) -> None:
    heard = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    out = probe.node.create_publisher(Transitions, names.TRANSITIONS, qos.EXPERIENCE_WRITER)
    lost: set[int] = set()

    def pass_on(msg: Transitions) -> None:
        if msg.evaluation % 3 == 0 and msg.evaluation not in lost:
            lost.add(msg.evaluation)
            return
        for _ in range(1 + msg.evaluation % 2):
            out.publish(msg)

    probe.node.create_subscription(Transitions, "bad_link", pass_on, qos.EXPERIENCE_READER)
    remapped = ("-r", "__node:=far", "-r", f"{names.TRANSITIONS}:=bad_link")
    graph.start("evaluator", {"task": "qd_walker"}, *remapped)
    signs = probe.listen(NodeStatus, names.STATUS, qos.STATUS)
    wait_until(lambda: any(s.node == "/far" for s in signs), "the evaluator behind the bad link")
    run_dir, parameters = tmp_path / "run", {"evaluations": 50, **system}
    run = graph.run(run_dir, **parameters)
    assert run.wait() == 0, run.output
    assert lost
    assert heard[-1].reevaluations > 0
    assert run_digest(run_dir) == search_digest(**parameters)


def test_an_evaluator_of_another_task_is_not_used_and_reported_once(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    signs = probe.listen(NodeStatus, names.STATUS, qos.STATUS)
    foreign = graph.start("evaluator", {"task": "qd_hopper"})
    wait_until(lambda: any(s.pid == foreign.process.pid for s in signs), "its heartbeat")
    run = graph.run(tmp_path / "run", evaluations=50)
    assert run.wait() == 0, run.output
    assert run.output.count("is not used: it has task 'qd_hopper'") == 1
    assert not any(s.done for s in signs if s.pid == foreign.process.pid)


def test_evaluators_started_by_hand_have_unique_names(graph: Graph, probe: Probe) -> None:
    signs = probe.listen(NodeStatus, names.STATUS, qos.STATUS)
    for _ in range(2):
        graph.start("evaluator", {"task": "qd_hopper"})
    wait_until(lambda: len({s.pid for s in signs}) == 2, "heartbeats of both")
    assert len({s.node for s in signs}) == 2
