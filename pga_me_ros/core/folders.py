"""Folders of a run: made if absent, and known to be writable before anything counts on them."""

from __future__ import annotations

import os
from pathlib import Path

from pga_me_ros.core.errors import StorageError


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, if absent.

    Raises:
        StorageError: It cannot be made, or cannot be written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(
            f"Cannot make the folder '{path}' ({error.strerror}); give run_dir a folder that "
            "can be written to."
        ) from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise StorageError(
            f"The folder '{path}' cannot be written to; give run_dir another folder or "
            "change its permissions."
        )


def sync_folder(path: Path) -> None:
    """Make what was renamed in a folder survive a power cut.

    Raises:
        OSError: The folder cannot be opened or the disk fails.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
