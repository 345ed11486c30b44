"""Definitions of message types, stored in recordings so that they can be read where the types are not installed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from pga_me_ros.errors import StorageError

SEPARATOR = "=" * 80


@dataclass(frozen=True)
class MessageDefinition:
    """A message type as rosbag2 stores it.

    Attributes:
        text: Its .msg file with all comments, and those of the types it contains.
        digest: Hash of its fields (REP 2011): equal if and only if the types are compatible.
    """

    text: str
    digest: str


def type_name(kind: type) -> str:
    """Return a message class's name as ROS 2 writes it, for example ``pga_me_msgs/msg/Metrics``."""
    return "/".join([*kind.__module__.split(".")[:2], kind.__name__])


def definition(type_name: str) -> MessageDefinition:
    """Return the definition of an installed message type.

    Args:
        type_name: For example ``pga_me_msgs/msg/Metrics``.

    Raises:
        StorageError: The package is not installed, or lacks its definitions.
    """
    try:
        path = _file(type_name)
        hashes = json.loads(path.with_suffix(".json").read_text())["type_hashes"]
        digests = {entry["type_name"]: entry["hash_string"] for entry in hashes}
        parts = [path.read_text()]
        parts += [
            f"{SEPARATOR}\nMSG: {name.replace('/msg/', '/')}\n{_file(name).read_text()}"
            for name in digests
            if name != type_name
        ]
        return MessageDefinition("\n".join(parts), digests[type_name])
    except (PackageNotFoundError, OSError, ValueError, KeyError) as error:
        raise StorageError(
            f"The definition of {type_name} cannot be found ({error}); source the workspace or environment that has it."
        ) from None


def _file(type_name: str) -> Path:
    package, _, name = type_name.split("/")
    return Path(get_package_share_directory(package)) / "msg" / f"{name}.msg"
