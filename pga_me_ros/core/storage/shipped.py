"""Repertoires that come with the package, named like ``zoo/qd_hopper`` wherever a run or its file is asked for."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pga_me_ros.errors import StorageError, nearest_name
from pga_me_ros.paths import install_prefixes, user_path

ZOO = "zoo"
"""First part of the name of a shipped repertoire."""

FOLDER = "repertoires"
"""Folder that holds one folder per shipped repertoire, in a checkout and where the package is installed."""

VARIABLE = "PGA_ME_ROS_REPERTOIRES"
"""Environment variable with further such folders, joined as in PATH; they are looked in first."""

REPERTOIRE = "repertoire.db"
"""Name of the repertoire file in the folder of a run."""

_PACKAGE = "pga_me_ros"


def shipped() -> dict[str, Path]:
    """Return the folders of all shipped repertoires by name, without ``zoo/``; of equal names the first counts."""
    found: dict[str, Path] = {}
    for place in _places():
        for file in sorted(place.glob(f"*/{REPERTOIRE}")):
            found.setdefault(file.parent.name, file.parent)
    return found


def is_shipped_name(path: Path) -> bool:
    """Whether a path is the name of a shipped repertoire, known or not: nothing else is there under it."""
    return len(path.parts) == 2 and path.parts[0] == ZOO and not path.exists()


def located(path: Path) -> Path:
    """Return what a user means by a path: the folder of a shipped repertoire (``zoo/NAME``), or the path itself.

    Raises:
        StorageError: It is the name of a shipped repertoire, but there is none of that name.
    """
    path = user_path(path)
    return shipped_folder(path) if is_shipped_name(path) else path


def shipped_folder(path: Path) -> Path:
    """Return the folder of a shipped repertoire.

    Args:
        path: Its name, for example ``zoo/qd_hopper``.

    Raises:
        StorageError: There is none of that name.
    """
    known, name = shipped(), path.name
    if name not in known:
        names = ", ".join(f"{ZOO}/{other}" for other in known) or "none"
        near = nearest_name(f"{ZOO}/{name}", [f"{ZOO}/{other}" for other in known])
        raise StorageError(
            f"There is no repertoire '{ZOO}/{name}'{near}; those that come with this package are: {names}."
        )
    return known[name]


def _places() -> Iterator[Path]:
    """Yield the folders that may hold shipped repertoires, the first ones first."""
    yield from (
        user_path(place) for place in os.environ.get(VARIABLE, "").split(os.pathsep) if place
    )
    yield Path(__file__).resolve().parents[3] / FOLDER  # a checkout
    for prefix in install_prefixes():
        yield prefix / "share" / _PACKAGE / FOLDER
