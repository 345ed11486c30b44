"""Sources of gaits: a served repertoire, or a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.task import Future

from pga_me_ros.client import RepertoireClient
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.player.gait import Gait


class Source(Protocol):
    """A repertoire.

    Attributes:
        task: Name that the task is loaded by.
        settings: Settings of the run.
    """

    task: str
    settings: Settings

    def choose(self, wanted: Mapping[str, Any]) -> Gait:
        """Return a gait.

        Args:
            wanted: Arguments of `RepertoireClient.get_behavior`.

        Raises:
            PgaError: No gait matches, or there is no response.
        """
        ...


class Served:
    """A repertoire that another node serves, and that may still grow.

    Args:
        node: Node that makes the calls; another thread spins it.
        wait: Waits for a future and returns its result.

    Raises:
        RepertoireTimeoutError: No repertoire is served.
    """

    def __init__(self, node: Node, wait: Callable[[Future], Any]) -> None:
        self._client = RepertoireClient(node)
        self._wait = wait
        self.settings = Settings.from_stored(wait(self._client.get_info_async()).settings)
        self.task = self.settings.task

    def choose(self, wanted: Mapping[str, Any]) -> Gait:
        """Return a gait, see `Source`."""
        gait: Gait = self._wait(self._client.get_behavior_async(**wanted))
        return gait


class Stored:
    """A repertoire file.

    Args:
        path: The file, or the folder of its run.

    Raises:
        StorageError: There is no repertoire, it is damaged, or it holds no behavior yet.
    """

    def __init__(self, path: Path) -> None:
        self._run = StoredRun.load(path)
        self.settings = self._run.settings
        self.task = self.settings.task

    def choose(self, wanted: Mapping[str, Any]) -> Gait:
        """Return a gait, see `Source`."""
        return self._run.choose(**wanted)
