"""What a hanging subscriber costs an evaluator: evaluations per second with and without one, and memory.

Run: `.venv/bin/python bench/foreign_subscriber.py [--rounds 6]`; the last line is JSON. One evaluator simulates a task
whose episodes cost little but hold much data, so that it publishes 80 kB many times a second. Stretches without and
with a subscriber take turns. The subscriber is RELIABLE, receives the first episodes and is then suspended (SIGSTOP),
like a suspended terminal or a recorder whose disk hangs.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import select
import signal
import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
from _measure import seconds, spread
from pga_me_msgs.msg import Transitions
from pga_me_msgs.srv import Evaluate
from rclpy.node import Node
from rclpy.qos import QoSProfile

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import flat
from pga_me_ros.ros.environment import prepare_environment

TASK = "_talkative:TalkativeTask"
SHAPE = MlpShape((100, 4, 2))
CHUNK = 20
STRETCH = 25
"""Chunks per stretch: 500 episodes, more than twice an evaluator's history."""


class Driver:
    """Has an evaluator simulate chunk after chunk, and subscribes like the critic trainer."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._client = node.create_client(Evaluate, "busy/evaluate")
        self.asked = self.arrived = 0
        node.create_subscription(Transitions, names.TRANSITIONS, self._count, qos.EXPERIENCE_READER)
        self._client.wait_for_service()

    def seconds_per_chunk(self) -> float:
        """Return the median over one stretch."""
        return statistics.median(seconds(self.chunk) for _ in range(STRETCH))

    def chunk(self) -> None:
        """Have one chunk simulated."""
        ids = range(self.asked, self.asked + CHUNK)
        request = Evaluate.Request(task=TASK, evaluations=ids, layer_sizes=SHAPE.sizes)
        request.parameters = flat(np.zeros((CHUNK, SHAPE.parameter_count)), "f")
        future = self._client.call_async(request)
        while not future.done():
            rclpy.spin_once(self._node, timeout_sec=0.1)
        if not future.result().accepted:
            raise SystemExit(future.result().message)
        self.asked += CHUNK

    def wait_for_all(self) -> None:
        """Wait until every episode has arrived."""
        while self.arrived < self.asked:
            rclpy.spin_once(self._node, timeout_sec=0.1)

    def _count(self, _: Transitions) -> None:
        self.arrived += 1


def listen() -> None:
    """Run the subscriber: a plain node that reports the first message it receives."""
    rclpy.init()
    node = rclpy.create_node("foreign")
    heard: list[int] = []

    def take(msg: Transitions) -> None:
        if not heard:
            print("heard", flush=True)
        heard[:] = [msg.evaluation]

    node.create_subscription(Transitions, names.TRANSITIONS, take, QoSProfile(depth=10))
    rclpy.spin(node)


@contextmanager
def hung_subscriber(driver: Driver) -> Iterator[None]:
    """Start a subscriber, let it receive a message, and suspend it; at the end, it exits cleanly."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--listen"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # messages of rclpy at its end do not matter
    )
    assert process.stdout is not None
    try:
        while not select.select([process.stdout], [], [], 0.0)[0]:
            driver.chunk()
        process.send_signal(signal.SIGSTOP)
        yield
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()  # not killed: others would consider it alive for another 20 s
        process.wait()


def megabytes(pid: int) -> float:
    """Return the resident memory of a process."""
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    assert found
    return int(found[1]) / 1024


def measure(driver: Driver, evaluator: int, rounds: int) -> dict[str, object]:
    """Take turns, and return the figures."""
    for _ in range(STRETCH):
        driver.chunk()
    alone = megabytes(evaluator)
    ratios, memory = [], []
    for _ in range(rounds):
        without = driver.seconds_per_chunk()
        with hung_subscriber(driver):
            ratios.append(without / driver.seconds_per_chunk())
            memory.append(megabytes(evaluator) - alone)
        print(f"rate {ratios[-1]:.2f} of that without; memory {memory[-1]:+.0f} MB", flush=True)
    driver.wait_for_all()
    return {"rate": spread(ratios), "more_megabytes": [round(m, 1) for m in memory]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--listen", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    prepare_environment()
    if arguments.listen:
        return listen()
    here = str(Path(__file__).resolve().parent)
    path = os.pathsep.join(filter(None, [here, os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", "pga_me_ros.nodes.evaluator", "--ros-args"]
    command += ["-p", f"task:={TASK}", "-r", "__node:=busy"]
    evaluator = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path})
    rclpy.init()
    node = rclpy.create_node("driver")
    try:
        figures = measure(Driver(node), evaluator.pid, arguments.rounds)
    finally:
        evaluator.terminate()
        evaluator.wait()
        node.destroy_node()
        rclpy.shutdown()
    print(json.dumps({"bench": "foreign_subscriber", "figures": figures}))
    return None


if __name__ == "__main__":
    main()
