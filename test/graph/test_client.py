"""The client that robots import: how its calls wait, whoever spins the node, and how they end without an answer."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from domain_coordinator import domain_id
from graph import Graph, wait_until
from pga_me_msgs.srv import GetBehavior
from rclpy.context import Context
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from stored import Served

from pga_me_ros.client import (
    Behavior,
    BlockedExecutorError,
    RepertoireClient,
    RepertoireTimeoutError,
)
from pga_me_ros.errors import RequestError

SHORT = 0.3
"""Seconds, enough to see that nobody answers."""


@contextmanager
def context_in(domain: int) -> Iterator[Context]:
    """Join a domain; nodes of one context find immediately what another of its nodes has found."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        context = Context()
        rclpy.init(context=context, domain_id=domain)
    yield context
    context.shutdown()


@pytest.fixture(scope="module")
def context(repertoire: Served) -> Iterator[Context]:
    with context_in(repertoire.graph.domain) as context:
        yield context


@pytest.fixture(scope="module")
def nobody() -> Iterator[Context]:
    """Return a context in a ROS domain without services."""
    with domain_id() as domain, context_in(domain) as context:
        yield context


@dataclass
class Robots:
    """Nodes that use clients."""

    nodes: list[Node] = field(default_factory=list)
    spinners: list[tuple[Executor, threading.Thread]] = field(default_factory=list)

    def node(self, context: Context) -> Node:
        self.nodes.append(rclpy.create_node("robot", context=context))
        return self.nodes[-1]

    def spin(self, node: Node, executor: Executor | None = None) -> None:
        executor = executor or SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        self.spinners.append((executor, thread))

    def close(self) -> None:
        for executor, thread in self.spinners:
            executor.shutdown()
            thread.join()
        for node in self.nodes:
            node.destroy_node()


@pytest.fixture
def robots() -> Iterator[Robots]:
    robots = Robots()
    yield robots
    robots.close()


@pytest.fixture
def client(context: Context, robots: Robots) -> RepertoireClient:
    """Return a client whose node is not spun."""
    return RepertoireClient(robots.node(context))


def once_in_callback(node: Node, act: Callable[[], Any]) -> None:
    """Make the node's executor call a function once."""

    def callback() -> Any:
        timer.cancel()
        return act()

    timer = node.create_timer(0.01, callback)


def outcome(future: Future) -> Any:
    wait_until(future.done, "the future")
    return future.result()


def test_a_main_program_can_call_through_a_node_that_is_not_spun(
    repertoire: Served, client: RepertoireClient
) -> None:
    behavior = client.get_behavior(best=True)
    elite = repertoire.archive.best()
    assert (behavior.cell, behavior.fitness, behavior.distance) == (elite.cell, elite.fitness, 0.0)
    assert np.array_equal(behavior.controller.parameters, elite.parameters)


def test_a_thread_can_call_while_another_spins(
    repertoire: Served, robots: Robots, context: Context
) -> None:
    node = robots.node(context)
    robots.spin(node)
    behavior = RepertoireClient(node).get_behavior(descriptor=[0.9, 0.1])
    assert behavior.cell == repertoire.archive.nearest([0.9, 0.1], 1)[0][0]


def test_threads_can_call_at_once_through_a_node_that_is_not_spun(client: RepertoireClient) -> None:
    found: list[Behavior] = []
    threads = [
        threading.Thread(target=lambda: found.append(client.get_behavior(best=True)))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4


def test_another_executor_may_take_the_node_over_afterwards(
    client: RepertoireClient, robots: Robots, context: Context
) -> None:
    client.get_behavior(best=True)
    robots.spin(client._node)
    assert outcome(client.get_behavior_async(best=True)).fitness > 0.0


def test_rclpy_spin_once_does_not_interfere(client: RepertoireClient) -> None:
    executor = SingleThreadedExecutor(context=client._node.context)
    rclpy.spin_once(client._node, executor=executor, timeout_sec=0.0)
    assert client.get_behavior(best=True).fitness > 0.0


def test_a_callback_can_call_with_a_done_callback(
    repertoire: Served, robots: Robots, context: Context
) -> None:
    node = robots.node(context)
    client = RepertoireClient(node)
    answers: list[Future] = []
    once_in_callback(
        node, lambda: client.get_behavior_async(best=True).add_done_callback(answers.append)
    )
    robots.spin(node)
    wait_until(lambda: bool(answers), "the done callback")
    assert answers[0].result().cell == repertoire.archive.best().cell


def test_a_coroutine_can_await(repertoire: Served, robots: Robots, context: Context) -> None:
    node = robots.node(context)
    client = RepertoireClient(node)
    executor = SingleThreadedExecutor(context=node.context)

    async def ask() -> int:
        return (await client.get_behavior_async(best=True)).cell

    robots.spin(node, executor)
    assert outcome(executor.create_task(ask)) == repertoire.archive.best().cell


def test_blocking_in_a_callback_is_an_error_not_a_deadlock(
    repertoire: Served, robots: Robots, context: Context
) -> None:
    node = robots.node(context)
    client = RepertoireClient(node)
    errors: list[str] = []

    def ask() -> None:
        with pytest.raises(BlockedExecutorError) as error:
            client.get_behavior(best=True)
        errors.append(str(error.value))

    once_in_callback(node, ask)
    robots.spin(node)
    wait_until(lambda: bool(errors), "the error")
    assert "ends in _async" in errors[0]


def test_blocking_in_a_callback_works_with_a_multithreaded_executor(
    repertoire: Served, robots: Robots, context: Context
) -> None:
    node = robots.node(context)
    client = RepertoireClient(node)
    found: list[Behavior] = []
    once_in_callback(node, lambda: found.append(client.get_behavior(best=True)))
    robots.spin(node, MultiThreadedExecutor(3, context=node.context))
    wait_until(lambda: bool(found), "an answer")
    assert found[0].cell == repertoire.archive.best().cell


def test_a_missing_service_is_reported_by_name(nobody: Context, robots: Robots) -> None:
    client = RepertoireClient(robots.node(nobody), timeout=SHORT)
    words = r"Service /repertoire/get_behavior was not available within 0\.3 s"
    with pytest.raises(RepertoireTimeoutError, match=words):
        client.get_behavior(best=True)


def test_a_closed_client_says_so(nobody: Context, robots: Robots) -> None:
    client = RepertoireClient(robots.node(nobody))
    client.close()
    with pytest.raises(RequestError, match="client is closed"):
        client.get_info()


def test_a_missing_service_ends_a_future_too(nobody: Context, robots: Robots) -> None:
    node = robots.node(nobody)
    robots.spin(node)
    with pytest.raises(RepertoireTimeoutError, match="/repertoire/get_info was not available"):
        outcome(RepertoireClient(node).get_info_async(timeout=SHORT))


def test_a_done_callback_may_call_again(nobody: Context, robots: Robots) -> None:
    node = robots.node(nobody)
    client = RepertoireClient(node, timeout=SHORT)
    ended: list[Future] = []

    def again(future: Future) -> None:
        ended.append(future)
        if len(ended) < 3:
            client.get_info_async().add_done_callback(again)

    client.get_info_async().add_done_callback(again)  # before anything spins, as in a constructor
    robots.spin(node)
    wait_until(lambda: len(ended) == 3, "three ends", timeout=10.0)
    assert all(isinstance(future.exception(), RepertoireTimeoutError) for future in ended)


def test_the_client_waits_for_a_service_that_starts_later(
    nobody: Context, robots: Robots, repertoire: Served, tmp_path: Path
) -> None:
    client = RepertoireClient(robots.node(nobody), prefix="/late", timeout=60.0)
    graph = Graph(nobody.get_domain_id(), tmp_path)
    graph.start("archive_manager", {"repertoire": repertoire.path}, "-r", "__ns:=/late")
    try:
        assert client.get_behavior(best=True).cell == repertoire.archive.best().cell
    finally:
        graph.kill()


def test_the_error_for_a_hanging_service_differs(
    repertoire: Served, client: RepertoireClient
) -> None:
    client.get_info()
    repertoire.manager.signal(signal.SIGSTOP)
    try:
        with pytest.raises(RepertoireTimeoutError, match=r"did not respond within 0\.3 s"):
            client.get_behavior(best=True, timeout=SHORT)
    finally:
        repertoire.manager.signal(signal.SIGCONT)
    assert client.get_behavior(best=True).fitness > 0.0


def test_a_busy_robot_gets_its_answer_after_many_answers_to_others(
    repertoire: Served, client: RepertoireClient, robots: Robots
) -> None:
    client.get_info()
    answer = client.get_behavior_async(best=True, timeout=60.0)
    for _ in range(30):
        repertoire.probe.call(
            GetBehavior, "repertoire/get_behavior", select=GetBehavior.Request.BEST
        )
    robots.spin(client._node)
    wait_until(answer.done, "the answer")
    assert answer.result().cell == repertoire.archive.best().cell


def test_many_requests_to_a_busy_server_are_all_answered(
    repertoire: Served, context: Context, robots: Robots
) -> None:
    crowd = [RepertoireClient(robots.node(context)) for _ in range(3)]
    for client in crowd:
        client.get_info()
    repertoire.manager.signal(signal.SIGSTOP)
    answers = [c.get_behavior_async(best=True, timeout=60.0) for c in crowd for _ in range(20)]
    repertoire.manager.signal(signal.SIGCONT)
    for client in crowd:
        robots.spin(client._node)
    wait_until(lambda: all(a.done() for a in answers), "all answers")
    assert [a.exception() for a in answers] == [None] * len(answers)


def test_the_error_for_an_executor_that_does_not_spin_differs(client: RepertoireClient) -> None:
    executor = SingleThreadedExecutor(context=client._node.context)
    executor.add_node(client._node)
    with pytest.raises(
        RepertoireTimeoutError, match="executor of node 'robot' handled no response"
    ):
        client.get_behavior(best=True, timeout=SHORT)


def test_a_page_can_be_requested_in_a_callback(client: RepertoireClient, robots: Robots) -> None:
    robots.spin(client._node)
    total, page = outcome(client.list_behaviors_async(2, 3))
    assert (total, len(page)) == (16, 3)
