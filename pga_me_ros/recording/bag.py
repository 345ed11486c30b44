"""rosbag2 folders with MCAP storage: written and read as bytes, without rosbag2."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import yaml
from rclpy.qos import QoSProfile

from pga_me_ros.dependencies import imported
from pga_me_ros.errors import PgaError, StorageError
from pga_me_ros.recording.definitions import definition
from pga_me_ros.recording.older import SEQUENCES_SINCE, completed

DIGEST = "sha256 of "
"""Key prefix in the metadata, followed by a topic's name: the digest of all its messages, because the MCAP files that
rosbags writes have no checksums."""

FORMAT_VERSION = 9
"""Version of the rosbag2 format, as in ROS 2 Jazzy."""

FOREVER = (9223372036, 854775807)
"""Seconds and nanoseconds that mean "no limit" to rosbag2."""


class Message(NamedTuple):
    """A recorded message.

    Attributes:
        topic: Full name of its topic.
        type_name: Type, for example ``pga_me_msgs/msg/Metrics``.
        time: When it was recorded [ns since 1970].
        data: Serialized message.
    """

    topic: str
    type_name: str
    time: int
    data: bytes


class BagWriter:
    """A new recording. It is incomplete until `close` writes the metadata.

    Args:
        path: Its folder, which must not exist.

    Attributes:
        messages: Number of messages written so far.
        size: Their size in bytes.

    Raises:
        StorageError: The folder exists or cannot be made.
        MissingDependencyError: The rosbags package is not installed.
    """

    def __init__(self, path: Path) -> None:
        self._rosbags = require_rosbags()
        self._path = path
        self.messages = self.size = 0
        if path.exists() or path.is_symlink():
            raise StorageError(
                f"'{path}' exists already; give the recording a folder that does not."
            )
        rosbag2 = self._rosbags.rosbag2
        self._writer = rosbag2.Writer(
            path, version=FORMAT_VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP
        )
        self._connections: dict[str, Any] = {}
        self._digests: dict[str, Any] = {}
        self._last = 0
        with self._faults():
            self._writer.open()

    def add(self, topic: str, type_name: str, offered: QoSProfile) -> None:
        """Add a topic.

        Args:
            topic: Full name.
            type_name: Its type.
            offered: Quality of service of its publishers, which a player offers, too.

        Raises:
            StorageError: The type is not installed.
        """
        of = definition(type_name)
        with self._faults():
            self._connections[topic] = self._writer.add_connection(
                topic,
                type_name,
                msgdef=of.text,
                rihs01=of.digest,
                offered_qos_profiles=[self._qos(offered)],
            )
        self._digests[topic] = hashlib.sha256()

    def write(self, topic: str, data: bytes) -> None:
        """Add a serialized message of a topic that was added, with the present time.

        Raises:
            StorageError: The message cannot be written.
        """
        # A clock that was set back must not change the order, on which the digest depends.
        self._last = max(time.time_ns(), self._last + 1)
        with self._faults():
            self._writer.write(self._connections[topic], self._last, data)
        self._digests[topic].update(data)
        self.messages += 1
        self.size += len(data)

    def close(self) -> None:
        """Write the index and the metadata.

        Raises:
            StorageError: The files cannot be written.
        """
        for topic, digest in self._digests.items():
            self._writer.set_custom_data(f"{DIGEST}{topic}", digest.hexdigest())
        with self._faults():
            self._writer.close()

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except (OSError, self._rosbags.rosbag2.WriterError) as error:
            reason = getattr(error, "strerror", None) or error
            raise StorageError(
                f"The recording '{self._path}' cannot be written ({reason}); check its folder, its permissions and the "
                "space on it."
            ) from None

    def _qos(self, offered: QoSProfile) -> Any:
        kinds = self._rosbags.interfaces
        forever = kinds.QosTime(*FOREVER)
        return kinds.Qos(
            history=kinds.QosHistory(offered.history.value),
            depth=offered.depth,
            reliability=kinds.QosReliability(offered.reliability.value),
            durability=kinds.QosDurability(offered.durability.value),
            deadline=forever,
            lifespan=forever,
            liveliness=kinds.QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=forever,
            avoid_ros_namespace_conventions=False,
        )


def read_bag(path: Path, type_names: Iterable[str]) -> Iterator[Message]:
    """Yield a recording's messages of some types, in the order they were recorded.

    Messages of an older version that are known to lack fields get them, empty (`older`).

    Args:
        path: Folder of a recording, of `BagWriter` or of ``ros2 bag record``.
        type_names: Types to return; others are ignored.

    Raises:
        StorageError: The bag is not a recording, was not closed, is damaged, or has other versions of its types than
            those installed. If the recording has digests, damage within messages is found after the last one.
        MissingDependencyError: The rosbags package is not installed.
    """
    rosbags = require_rosbags()
    _require_folder(path)
    wanted = {name: definition(name) for name in type_names}
    try:
        with rosbags.rosbag2.Reader(path) as reader:
            connections = [c for c in reader.connections if c.msgtype in wanted]
            lacking = {
                c.topic: SEQUENCES_SINCE.get(c.msgtype, {}).get(c.digest, 0) for c in connections
            }
            for c in connections:
                if c.digest and c.digest != wanted[c.msgtype].digest and not lacking[c.topic]:
                    raise StorageError(
                        f"'{path}' holds {c.msgtype} with other fields than the type installed here; read it with the "
                        "pga_me_msgs that recorded it."
                    )
            digests = {c.topic: hashlib.sha256() for c in connections}
            for connection, stamp, data in reader.messages(connections) if connections else ():
                digests[connection.topic].update(data)
                whole = completed(bytes(data), lacking[connection.topic])
                yield Message(connection.topic, connection.msgtype, stamp, whole)
            known = _custom_data(path)
            for topic, digest in digests.items():
                if known.get(f"{DIGEST}{topic}", digest.hexdigest()) != digest.hexdigest():
                    raise _damaged(path, f"messages of {topic} are not as they were recorded")
    except (PgaError, GeneratorExit):
        raise
    except Exception as error:  # a damaged file may make the reader raise anything
        raise _damaged(path, f"{type(error).__name__}: {error}") from error


def topics(path: Path) -> dict[str, str]:
    """Return the types of a recording's topics by name.

    Raises:
        StorageError: The bag is not a recording, was not closed, or is damaged.
        MissingDependencyError: The rosbags package is not installed.
    """
    rosbags = require_rosbags()
    _require_folder(path)
    try:
        with rosbags.rosbag2.Reader(path) as reader:
            return {c.topic: c.msgtype for c in reader.connections}
    except Exception as error:  # a damaged file may make the reader raise anything
        raise _damaged(path, f"{type(error).__name__}: {error}") from error


def require_rosbags() -> ModuleType:
    """Return the rosbags package.

    Raises:
        MissingDependencyError: rosbags is not installed.
    """
    return imported("rosbags", "rosbags.interfaces", "rosbags.rosbag2")


def _require_folder(path: Path) -> None:
    """Make sure that a path can be a recording.

    Raises:
        StorageError: There is no such folder, or it has no metadata.
    """
    if not path.exists():
        raise StorageError(f"There is no recording '{path}'; give the folder that `record` made.")
    if (path / "metadata.yaml").is_file():
        return
    if path.is_dir() and any(path.glob("*.mcap")):
        raise StorageError(
            f"The recording '{path}' was not closed because its program was killed: metadata.yaml is missing. "
            "`mcap recover` and `ros2 bag reindex` can repair it."
        )
    raise StorageError(
        f"'{path}' is not a recording: it has no metadata.yaml; give the folder that `record` made."
    )


def _custom_data(path: Path) -> dict[str, str]:
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    return metadata["rosbag2_bagfile_information"].get("custom_data") or {}


def _damaged(path: Path, reason: str) -> StorageError:
    return StorageError(
        f"The recording '{path}' is damaged ({' '.join(reason.split())[:300]}); restore it from a copy."
    )
