"""What the page shows of the nodes of a graph: those of its namespace, as long as they are there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from domain_coordinator import domain_id
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from pga_me_ros.explorer.run_watch import FORGOTTEN_AFTER, SILENT_AFTER, RunWatch
from pga_me_ros.ros import names, qos

Make = Callable[..., Node]


@pytest.fixture
def executor(monkeypatch: pytest.MonkeyPatch) -> Iterator[SingleThreadedExecutor]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with domain_id() as domain:
        rclpy.init(domain_id=domain)
        yield SingleThreadedExecutor()
        rclpy.shutdown()


@pytest.fixture
def make(executor: SingleThreadedExecutor) -> Make:
    """Return a function that makes nodes, which are spun by `wait`."""

    def make(name: str, namespace: str = "/") -> Node:
        node = rclpy.create_node(name, namespace=namespace)
        executor.add_node(node)
        return node

    return make


def wait(
    executor: SingleThreadedExecutor, act: Callable[[], object], until: Callable[[], bool]
) -> None:
    """Do something again and again until a condition is true: messages before discovery are lost."""
    end = time.monotonic() + 30.0
    while not until():
        assert time.monotonic() < end
        act()
        executor.spin_once(timeout_sec=0.05)


@pytest.mark.parametrize("namespace", ["/", "/left"])
def test_the_log_is_that_of_the_nodes_of_the_namespace(
    namespace: str, executor: SingleThreadedExecutor, make: Make
) -> None:
    watch = RunWatch(make("explorer", namespace))
    nodes = [make("evaluator", space) for space in ("/", "/left", "/left/arm")]
    inner = nodes[("/", "/left").index(namespace)].get_logger().get_child("inner")
    lines = lambda: watch.state()["log"]  # noqa: E731
    others = [node.get_logger() for node in nodes if node.get_namespace() != namespace]

    def speak() -> None:
        for logger in others:
            logger.info("theirs")
        inner.info("ours")

    wait(executor, speak, lambda: len(lines()) > 20)
    prefix = "" if namespace == "/" else "left."
    assert set(lines()) == {f"{prefix}evaluator.inner: ours"}


def test_a_node_that_is_gone_is_silent_and_then_forgotten(
    executor: SingleThreadedExecutor, make: Make
) -> None:
    now = [100.0]
    watch = RunWatch(make("explorer"), lambda: now[0])
    publisher = make("evaluator").create_publisher(
        DiagnosticArray, names.DIAGNOSTICS, qos.DIAGNOSTICS
    )
    values = [KeyValue(key="rate", value="7 per second")]
    status = DiagnosticStatus(name="/evaluator", message="OK", values=values)

    def nodes() -> list[dict[str, str]]:
        return watch.state()["nodes"]

    wait(
        executor, lambda: publisher.publish(DiagnosticArray(status=[status])), lambda: bool(nodes())
    )
    now[0] += SILENT_AFTER
    assert nodes() == [{"node": "/evaluator", "says": "OK", "rate": "7 per second"}]
    now[0] += 1.0
    assert nodes() == [{"node": "/evaluator", "says": "silent for 6 s"}]
    now[0] += FORGOTTEN_AFTER
    assert nodes() == []
