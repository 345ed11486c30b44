"""The nodes that the demonstration starts: a repertoire that is served, and an adapter, in a namespace of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.client import Client

from pga_me_ros.errors import PgaError
from pga_me_ros.process.child import ChildProcess, python_module, stop
from pga_me_ros.yaml_files import parameter

READY = 60.0
"""Seconds that a node may take to start, on a busy machine."""

TICK = 0.1
"""Seconds between two checks whether a node that does not answer is alive."""


class CompanionError(PgaError):
    """A node that the demonstration needs has ended, or does not start."""


class Companions:
    """Nodes that live as long as the demonstration.

    Args:
        folder: Folder for their logs.
        namespace: Namespace of all of them.
        clients: Clients of services that they must offer.
    """

    def __init__(self, folder: Path, namespace: str, clients: Sequence[Client]) -> None:
        self._folder, self._namespace, self._clients = folder, namespace, clients
        self._nodes: dict[str, ChildProcess] = {}

    def start(self, name: str, parameters: Mapping[str, Any]) -> None:
        """Start a node; its name is that of its module in `pga_me_ros.nodes`."""
        arguments = ["--ros-args", "-r", f"__ns:={self._namespace}"]
        for key, value in parameters.items():
            arguments += ["-p", parameter(key, value)]
        command = python_module(f"pga_me_ros.nodes.{name}", *arguments)
        self._nodes[name] = ChildProcess(command, self._folder / f"{name}.log")

    def wait(self) -> None:
        """Wait until all services are there.

        Raises:
            CompanionError: A node has ended, or takes too long.
        """
        for client in self._clients:
            for _ in range(int(READY / TICK)):
                self.require_alive()
                if client.wait_for_service(timeout_sec=TICK):
                    break
            else:
                raise CompanionError(
                    f"Service {client.srv_name} is not there after {READY:g} s; the machine may be too busy. Try again."
                )

    def require_alive(self) -> None:
        """Make sure that all nodes live.

        Raises:
            CompanionError: One has ended; the message has its last words.
        """
        for name, process in self._nodes.items():
            if not process.alive:
                words = process.last_words() or f"exit code {process.exit_code}"
                raise CompanionError(f"The node {name} has ended: {words}")

    def close(self) -> None:
        """Stop all nodes; returns when they are gone."""
        stop(list(self._nodes.values()))
