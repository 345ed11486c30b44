"""Folders and files of a run: checks that folders are writable, atomic and durable replacement of files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO

from pga_me_ros.errors import RequestError, SettingsError, StorageError


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, if absent.

    Raises:
        StorageError: The folder cannot be made, or cannot be written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(
            f"Cannot make the folder '{path}' ({error.strerror}); choose another one, in a folder that "
            "can be written to."
        ) from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise StorageError(
            f"The folder '{path}' cannot be written to; choose another folder, or "
            "change its permissions."
        )


def require_reachable(name: str, path: Path) -> None:
    """Make sure that a path is accessible, and readable if it exists; it need not exist.

    Args:
        name: Setting that gives it.
        path: File or folder.

    Raises:
        SettingsError: A folder on the way may not be entered, the path is too long or circular, or the file or folder
            may not be read.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return  # it will be made, or reported where it is needed
    except OSError as error:
        raise SettingsError(
            f"{name} is '{path}', which cannot be reached ({error.strerror}); give a path whose folders you may enter."
        ) from None
    if not os.access(path, os.R_OK):
        raise SettingsError(f"{name} is '{path}', which you may not read; change its permissions.")


def replace_file(
    path: Path, content: bytes | Callable[[BinaryIO], None], *, shared: bool = False
) -> None:
    """Write a file under another name, then rename it: a crash or power cut leaves the old or the new file intact.

    Args:
        path: File to write or replace; its folder must exist.
        content: Bytes of the file, or a function that writes them into the open file.
        shared: Whether other processes may be replacing the same file now; each then writes under its own name.
            Otherwise the name is always the same, so that the leftovers of a killed process are overwritten.

    Raises:
        OSError: The file cannot be written or renamed; the old one is unchanged.
    """
    new = _beside(path, shared=shared)
    try:
        with new.open("wb") as file:
            if callable(content):
                content(file)
            else:
                file.write(content)
            file.flush()
            os.fsync(file.fileno())
        rename_file(new, path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise


def rename_file(path: Path, target: Path) -> None:
    """Rename a file within its folder, replacing any file of the new name; survives a power cut.

    Raises:
        OSError: The file cannot be renamed, or the disk fails.
    """
    os.replace(path, target)
    descriptor = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _beside(path: Path, *, shared: bool) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.new" if shared else f".{path.name}.new")


def save_bytes(path: Path, content: bytes) -> None:
    """Write a file for a user, as `replace_file` does.

    Raises:
        StorageError: The file cannot be written.
    """
    try:
        replace_file(path, content, shared=True)
    except OSError as error:
        raise _unwritable(path, error) from None


def require_writable(path: Path, endings: Sequence[str], option: str = "--out") -> None:
    """Make sure that `save_bytes` can write a file, before what goes into it is made.

    Args:
        path: The file.
        endings: Endings that its name may have.
        option: Option that gives it.

    Raises:
        RequestError: Its name has another ending, or is that of a folder.
        StorageError: Its folder is missing, or cannot be written to.
    """
    new, folder = _beside(path, shared=True), path.absolute().parent
    try:
        if path.suffix.lower() not in endings or path.is_dir():
            raise RequestError(
                f"{option} is '{path}'; give the name of a file that ends in {', '.join(endings)}."
            )
        if not folder.is_dir():
            raise StorageError(f"There is no folder '{folder}'; make it first.")
        new.touch()
        new.unlink()
    except OSError as error:
        raise _unwritable(path, error) from None


def _unwritable(path: Path, error: OSError) -> StorageError:
    return StorageError(
        f"'{path}' cannot be written ({error.strerror}); check the folder, its permissions and the space on it."
    )
