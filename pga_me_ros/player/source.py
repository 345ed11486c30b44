"""Where gaits come from: a repertoire that is being served, or a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.task import Future

from pga_me_ros.client import RepertoireClient
from pga_me_ros.core.settings import Settings
from pga_me_ros.player.stored import Gait, StoredRepertoire


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
            PgaError: None fits, or nobody answers.
        """
        ...


class Served:
    """A repertoire that another node serves, and may go on growing.

    Args:
        node: Node to ask through, spun by another thread.
        wait: Waits for a future and returns its result.

    Raises:
        RepertoireTimeoutError: Nobody serves one.
    """

    def __init__(self, node: Node, wait: Callable[[Future], Any]) -> None:
        self._client = RepertoireClient(node)
        self._wait = wait
        self.settings = Settings.from_mapping(wait(self._client.get_info_async()).settings)
        self.task = self.settings.task

    def choose(self, wanted: Mapping[str, Any]) -> Gait:
        """Return a gait, see `Source`."""
        return Gait.of(self._wait(self._client.get_behavior_async(**wanted)))


class Stored:
    """A repertoire file.

    Args:
        path: The file, or the folder of its run.

    Raises:
        StorageError: There is none, it is damaged, or it holds no gait yet.
    """

    def __init__(self, path: Path) -> None:
        self._repertoire = StoredRepertoire.load(path)
        self.task, self.settings = self._repertoire.task, self._repertoire.settings

    def choose(self, wanted: Mapping[str, Any]) -> Gait:
        """Return a gait, see `Source`."""
        choice = {name: value for name, value in wanted.items() if name != "best"}
        return self._repertoire.choose(**choice)
