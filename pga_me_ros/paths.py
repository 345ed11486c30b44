"""Paths: as users write them, with ``~`` for a home folder also where no shell expanded it, and where packages are."""

from __future__ import annotations

import os
import re
import sys
import zlib
from pathlib import Path

from pga_me_ros.errors import SettingsError


def expanded(text: str) -> str:
    """Return a path with its ``~`` or ``~USER`` expanded, otherwise unchanged.

    Shells expand it only at the beginning of a word, so not in ``-p run_dir:=~/run`` or ``--out=~/gait.gif``.

    Raises:
        SettingsError: There is no such user. Otherwise, a folder of that name would be made.
    """
    found = os.path.expanduser(text)
    if found.startswith("~"):
        user = text.split("/", 1)[0]
        raise SettingsError(
            f"'{text}' begins with {user}, but this machine knows no such home folder; write ./{text} for a folder "
            "of that name."
        )
    return found


def user_path(path: str | Path) -> Path:
    """Return the path that a user means, see `expanded`."""
    return Path(expanded(str(path)))


def listed_paths(text: str) -> list[Path]:
    """Return the paths that a user names in one text, separated by commas.

    If the text as a whole is the path of something, it is that one: its name may have a comma.

    Raises:
        SettingsError: An entry is empty, or as in `expanded`.
    """
    if os.path.exists(text):
        return [Path(text)]
    entries = [entry.strip() for entry in text.split(",")]
    if not all(entries):
        raise SettingsError(f"'{text}' has an empty entry; remove the comma next to it.")
    return [user_path(entry) for entry in entries]


def file_name(text: str) -> str:
    """Return a name, such as that of a task, as part of a file's name.

    What is not a letter, digit, point, hyphen or underscore becomes an underscore. A checksum is then added, so that
    different names stay different.
    """
    safe = re.sub(r"[^\w.-]", "_", text)
    return safe if safe == text else f"{safe}-{zlib.crc32(text.encode()):08x}"


def install_prefixes() -> list[Path]:
    """Return the folders below which ROS 2 packages, and those of this Python, are installed, first ones first."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    return [Path(prefix) for prefix in prefixes if prefix]
