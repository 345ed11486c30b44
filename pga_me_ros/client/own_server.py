"""A private archive manager: serves a repertoire to the client that started it, and ends with the client's process."""

from __future__ import annotations

import itertools
import os
import tempfile
from pathlib import Path

from rclpy.node import Node

from pga_me_ros.core.storage.shipped import located
from pga_me_ros.errors import PgaError, StorageError
from pga_me_ros.process.child import ChildProcess, python_module, stop
from pga_me_ros.yaml_files import parameter

_count = itertools.count(1)


class OwnServer:
    """An archive manager in a unique namespace.

    Args:
        node: Node of the client.
        repertoire: Repertoire to serve: ``zoo/NAME``, the folder of a run, or a repertoire file.

    Attributes:
        prefix: Its namespace.

    Raises:
        StorageError: There is no such repertoire.
    """

    def __init__(self, node: Node, repertoire: str | Path) -> None:
        path = located(Path(repertoire))
        if not path.exists():
            raise StorageError(
                f"There is no repertoire '{repertoire}'; give zoo/NAME, the folder of a run, or a repertoire file."
            )
        self.prefix = f"/{node.get_name()}_{os.getpid()}_{next(_count)}"
        self._output = tempfile.TemporaryDirectory(prefix="pga_me_ros-")
        arguments = ["--ros-args", "-r", f"__ns:={self.prefix}", "-p"]
        command = python_module(
            "pga_me_ros.nodes.archive_manager",
            *arguments,
            parameter("repertoire", str(path.resolve())),
        )
        self._process = ChildProcess(
            command,
            Path(self._output.name) / "archive_manager.log",
            environment={"ROS_DOMAIN_ID": str(node.context.get_domain_id())},
        )

    def require_alive(self) -> None:
        """Check that the server is still running.

        Raises:
            PgaError: The server has ended; the message says why.
        """
        if not self._process.alive:
            words = self._process.last_words() or "it printed nothing"
            raise PgaError(f"The client's own archive manager has ended: {words}")

    def close(self) -> None:
        """End the server."""
        stop([self._process])
        self._output.cleanup()
