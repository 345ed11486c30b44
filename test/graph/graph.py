"""Harness of the graph tests: start nodes as processes, talk to them, wait for conditions."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.rules import useless
from pga_me_ros.ros import qos
from pga_me_ros.ros.options import RunOptions

DEADLINE = 60.0
"""Seconds after which an expected event counts as missing."""

TINY = {
    "evaluations": 30,
    "random_init": 10,
    "batch_size": 10,
    "n_evo": 5,
    "n_grad": 2,
    "n_crit": 10,
    "transition_batch": 32,
    "cells": 64,
    "cvt_samples": 2000,
    "controller_hidden": [16, 16],
    "critic_hidden": [16, 16],
    "evaluators": 1,
    "serve": False,
    "discovery_wait": 0.0,
    "reevaluations": 0,
}
"""Parameters of a complete run that takes seconds: 1 generation of random controllers, 2 of variation."""

NOT_ALONE = {"discovery_wait": RunOptions.discovery_wait}
"""Parameters in addition to `TINY` of a run that must find another one in its domain, or that a probe must find before
its first states are past."""


def tiny(**parameters: Any) -> dict[str, Any]:
    """Return `TINY` with parameters added, without those that the algorithm or archive does not use."""
    algorithm = parameters.get("algorithm", Settings.algorithm)
    unused = useless(TINY, algorithm, parameters.get("archive", Settings.archive))
    return {**{n: v for n, v in TINY.items() if n not in unused}, **parameters}


def ros_arguments(parameters: Mapping[str, Any]) -> list[str]:
    """Return parameters as command-line arguments."""
    out = ["--ros-args"]
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        out += ["-p", f"{name}:={text}"]
    return out


def wait_until(true: Callable[[], bool], what: str, timeout: float = DEADLINE) -> None:
    """Wait for a condition, checking every 20 ms."""
    deadline = time.monotonic() + timeout
    pause = threading.Event()
    while not true():
        assert time.monotonic() < deadline, f"waited {timeout} s for: {what}"
        pause.wait(0.02)


@dataclass
class Started:
    """A node's process; its output goes to a file, so that no pipe can block it."""

    process: subprocess.Popen[bytes]
    log: Path

    @property
    def output(self) -> str:
        """Its output so far."""
        return self.log.read_text(errors="replace")

    def wait(self, timeout: float = DEADLINE) -> int:
        """Wait for it to end, and return its exit code."""
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still running after {timeout} s:\n{self.output}") from None

    def wait_for_output(self, text: str, timeout: float = DEADLINE) -> None:
        """Wait until it has printed a text."""

        def printed() -> bool:
            assert self.process.poll() is None or text in self.output, self.output
            return text in self.output

        wait_until(printed, f"{text!r} in:\n{self.output}", timeout)

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self.process.send_signal(number)


class Graph:
    """Nodes in one ROS domain."""

    def __init__(self, domain: int, folder: Path) -> None:
        self.domain = domain
        self.folder = folder
        self._started: list[Started] = []

    @property
    def environment(self) -> dict[str, str]:
        """Environment of every node."""
        return {
            **os.environ,
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONUNBUFFERED": "1",
        }

    def start(self, kind: str, parameters: Mapping[str, Any], *arguments: str) -> Started:
        """Start a node.

        Args:
            kind: Module in `pga_me_ros.nodes`.
            parameters: ROS parameters.
            arguments: Further ROS arguments, such as ``-r __ns:=/one``.
        """
        command = [sys.executable, "-m", f"pga_me_ros.nodes.{kind}"]
        return self.launch([*command, *ros_arguments(parameters), *arguments])

    def launch(self, command: list[str]) -> Started:
        """Start any command in this domain."""
        log = self.folder / f"output-{len(self._started)}.txt"
        with log.open("wb") as file:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=self.environment,
                cwd=self.folder,
            )
        self._started.append(Started(process, log))
        return self._started[-1]

    def run(self, run_dir: Path, *arguments: str, **parameters: Any) -> Started:
        """Start a tiny run; `parameters` are added to `TINY`."""
        values = tiny(run_dir=run_dir, **parameters)
        return self.start("orchestrator", values, *arguments)

    def kill(self) -> None:
        """Kill all remaining nodes."""
        for started in self._started:
            if started.process.poll() is None:
                started.process.kill()
                started.process.wait()


class Probe:
    """A node in this process whose callbacks run in a thread."""

    def __init__(self, domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("probe", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def call(self, srv_type: Any, name: str, timeout: float = DEADLINE, **fields: Any) -> Any:
        """Call a service and return its response; fields are those of the request."""
        client = self.node.create_client(srv_type, name, qos_profile=qos.CLIENT)
        wait_until(client.service_is_ready, f"service {name}", timeout)
        future = client.call_async(srv_type.Request(**fields))
        wait_until(future.done, f"an answer of {name}", timeout)
        return future.result()

    def listen(self, msg_type: Any, topic: str, profile: Any) -> list[Any]:
        """Return a list to which every message of a topic is added."""
        heard: list[Any] = []
        self.node.create_subscription(msg_type, topic, heard.append, profile)
        return heard

    def close(self) -> None:
        """Stop spinning and destroy the node."""
        self.executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        self.context.shutdown()

    def _spin(self) -> None:
        try:
            self.executor.spin()
        except ExternalShutdownException:
            return
