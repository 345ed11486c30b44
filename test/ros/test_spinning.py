"""How nodes spin and end, with a real executor."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from std_srvs.srv import Trigger

from pga_me_ros.errors import PgaError
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.spinning import EndingNode, spin

DEADLINE = 30.0


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> Iterator[Context]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = Context()
    with domain_id() as domain:
        rclpy.init(context=context, domain_id=domain)
        yield context
        context.try_shutdown()


@pytest.fixture
def node(context: Context) -> Iterator[EndingNode]:
    node = EndingNode("node", context=context)
    yield node
    node.destroy_node()


def after(seconds: float, node: EndingNode, do: Callable[[], None]) -> None:
    """Make a node's own callback do something once."""

    def once() -> None:
        timer.cancel()
        do()

    timer = node.create_timer(seconds, once)


def in_thread(work: Callable[[], Any]) -> Future[Any]:
    """Do something in another thread, for which a failing test need not wait."""
    done: Future[Any] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except Exception as error:
            done.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return done


def spinning(node: EndingNode) -> Future[None]:
    """Spin a node in another thread."""
    return in_thread(lambda: spin(node))


def spun(node: EndingNode) -> BaseException | None:
    """Spin a node in another thread, and return its outcome."""
    return spinning(node).exception(DEADLINE)


def test_a_node_ends_itself_with_an_outcome_and_logs_nothing(
    node: EndingNode, capfd: pytest.CaptureFixture[str]
) -> None:
    outcome = PgaError("enough")
    after(0.01, node, lambda: node.end(outcome))
    assert spun(node) is outcome
    assert capfd.readouterr() == ("", "")


def test_the_first_outcome_counts(node: EndingNode) -> None:
    first = PgaError("first")
    node.end(first)
    node.end(PgaError("second"))
    assert spun(node) is first


def test_another_thread_wakes_and_ends_an_idle_node(node: EndingNode) -> None:
    outcome = PgaError("from outside")
    began = threading.Event()
    after(0.01, node, began.set)
    serving = spinning(node)
    assert began.wait(DEADLINE)
    node.end(outcome)
    assert serving.exception(DEADLINE) is outcome


def test_an_exception_in_a_callback_ends_the_node(node: EndingNode) -> None:
    def fault() -> None:
        raise ValueError("a fault")

    after(0.01, node, fault)
    assert repr(spun(node)) == "ValueError('a fault')"


def test_a_shutdown_ends_the_node(node: EndingNode, context: Context) -> None:
    threading.Timer(0.1, context.shutdown).start()
    assert isinstance(spun(node), ExternalShutdownException)


def test_a_callback_that_a_signal_interrupts_ends_the_node(node: EndingNode) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    assert node.unless_ended(interrupted)() is None
    assert isinstance(node.outcome, KeyboardInterrupt)


def test_a_callback_that_fails_because_of_a_shutdown_ends_the_node(
    node: EndingNode, context: Context
) -> None:
    def fault() -> None:
        raise ValueError("a fault")

    callback = node.unless_ended(fault)
    with pytest.raises(ValueError, match="a fault"):
        callback()
    assert node.outcome is None
    context.shutdown()
    assert callback() is None
    assert isinstance(node.outcome, ExternalShutdownException)


def test_an_idle_node_uses_no_processor_time(node: EndingNode) -> None:
    after(1.0, node, lambda: node.end(PgaError("enough")))

    def used() -> float:
        start, began = time.thread_time(), time.monotonic()
        with pytest.raises(PgaError, match="enough"):
            spin(node)
        return (time.thread_time() - start) / (time.monotonic() - began)

    assert in_thread(used).result(DEADLINE) < 0.2


def test_a_service_whose_node_is_shut_down_meanwhile_does_not_answer(
    monkeypatch: pytest.MonkeyPatch, context: Context
) -> None:
    """The handler fails because of the shutdown, like everything that needs ROS."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(context.get_domain_id()))
    rclpy.init()
    serving = GraphNode("node")

    def handle(request: Trigger.Request, response: Trigger.Response) -> None:
        rclpy.shutdown()
        raise RuntimeError("no ROS any more")

    serving.serve(Trigger, "service", handle, ok_field="success")
    asking = rclpy.create_node("asking", context=context)
    client = asking.create_client(Trigger, "service")
    assert client.wait_for_service(DEADLINE)
    answer = client.call_async(Trigger.Request())
    assert isinstance(spun(serving), ExternalShutdownException)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(asking)
    executor.spin_until_future_complete(answer, 0.5)
    assert not answer.done()
    serving.destroy_node()
    asking.destroy_node()
