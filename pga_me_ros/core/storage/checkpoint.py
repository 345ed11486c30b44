"""Checkpoint files: named arrays and some JSON in one file, with a checksum.

Layout: 8 bytes of magic, the length of the header as a little-endian uint64, the header in JSON,
the arrays one after the other (each starting at a multiple of 64 bytes), and the SHA-256 of
everything before it. Nothing is ever unpickled.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.storage.files import replace_file
from pga_me_ros.errors import StorageError

Array = NDArray[Any]

MAGIC = b"PGAMECK1"
"""Kind of file, and the version of its layout in the last byte."""

ALIGNMENT = 64
DIGEST_SIZE = 32
HEADER_MOST = 1 << 20
"""Bytes at the beginning of a file that are enough for any header."""

PLAIN_KINDS = "biuf"
"""Array kinds that a file may hold: booleans, integers, floats; never objects."""


def save_checkpoint(path: str | Path, arrays: Mapping[str, Array], meta: Mapping[str, Any]) -> None:
    """Write a checkpoint, replacing an older one; a crash leaves one of the two intact.

    Args:
        path: File to write.
        arrays: Arrays of booleans, integers or floats, of any shape.
        meta: Anything that JSON can hold.

    Raises:
        StorageError: The file cannot be written, or it cannot hold an array or `meta`.
    """
    path = Path(path)
    plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    header = _header(path, arrays, plain, meta)
    try:
        replace_file(path, lambda file: _write_content(file, header, plain))
    except OSError as error:
        raise StorageError(
            f"Cannot write checkpoint {path}: {error.strerror}. "
            "Free space on its disk, or give a folder that exists and is writable."
        ) from error


def load_checkpoint(path: str | Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read a checkpoint and verify its checksum.

    Args:
        path: File that `save_checkpoint` wrote.

    Returns:
        The arrays by name, writable, and the metadata.

    Raises:
        StorageError: The file cannot be read, is not a checkpoint, or is damaged; the message names
            the file.
    """
    path = Path(path)
    content = _read(path)
    _require_magic(path, bytes(content[: len(MAGIC)]))
    body = memoryview(content)[:-DIGEST_SIZE]
    if hashlib.sha256(body).digest() != content[-DIGEST_SIZE:]:
        raise StorageError(
            f"Checkpoint {path} is damaged: its checksum does not match, so it was cut short or "
            "changed. Restore it from a copy, or start a new run."
        )
    start = len(MAGIC) + 8
    (length,) = struct.unpack("<Q", body[len(MAGIC) : start])
    header = json.loads(bytes(body[start : start + length]))
    offset = _aligned(start + length)
    arrays = {}
    for entry in header["arrays"]:
        dtype, shape = np.dtype(entry["dtype"]), tuple(entry["shape"])
        count = int(np.prod(shape, dtype=np.int64))
        arrays[entry["name"]] = np.frombuffer(content, dtype, count, offset).reshape(shape)
        offset = _aligned(offset + count * dtype.itemsize)
    return arrays, header["meta"]


def checkpoint_shapes(path: str | Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a checkpoint's arrays by name, without reading the arrays or verifying the checksum.

    Raises:
        StorageError: The file cannot be read, is not a checkpoint, or its header is damaged.
    """
    path = Path(path)
    content = _read(path, HEADER_MOST)
    _require_magic(path, bytes(content[: len(MAGIC)]))
    try:
        start = len(MAGIC) + 8
        (length,) = struct.unpack("<Q", content[len(MAGIC) : start])
        header = json.loads(bytes(content[start : start + length]))
        return {entry["name"]: tuple(entry["shape"]) for entry in header["arrays"]}
    except (struct.error, ValueError, KeyError, TypeError):
        raise StorageError(
            f"Checkpoint {path} is damaged: its header cannot be read. Restore it from a copy, or "
            "start a new run."
        ) from None


def _require_magic(path: Path, found: bytes) -> None:
    if found == MAGIC:
        return
    if found[:-1] == MAGIC[:-1] and len(found) == len(MAGIC):
        raise StorageError(
            f"Checkpoint {path} has layout version {found[-1:].decode(errors='replace')!r}, but this "
            f"program reads {MAGIC[-1:].decode()!r}. Use the pga_me_ros that wrote it."
        )
    raise StorageError(
        f"{path} is not a checkpoint of this program, or its beginning is damaged. Restore it from a "
        "copy, or start a new run."
    )


def _header(
    path: Path, arrays: Mapping[str, Array], plain: Mapping[str, Array], meta: Mapping[str, Any]
) -> bytes:
    entries = []
    for name, array in plain.items():
        if array.dtype.kind not in PLAIN_KINDS:
            raise StorageError(
                f"Array '{name}' of {array.dtype} cannot be stored in checkpoint {path}; "
                "a checkpoint holds only booleans, integers and floats."
            )
        # ascontiguousarray makes a scalar one-dimensional, so take the shape of the original.
        shape = list(np.shape(arrays[name]))
        entries.append({"name": name, "dtype": array.dtype.str, "shape": shape})
    try:
        return json.dumps({"arrays": entries, "meta": dict(meta)}).encode()
    except TypeError as error:
        raise StorageError(f"Metadata of checkpoint {path} is not JSON: {error}.") from error


def _write_content(file: BinaryIO, header: bytes, plain: Mapping[str, Array]) -> None:
    digest = hashlib.sha256()
    position = 0

    def write(part: bytes | memoryview) -> None:
        nonlocal position
        digest.update(part)
        file.write(part)
        position += len(part)

    write(MAGIC + struct.pack("<Q", len(header)) + header)
    for array in plain.values():
        write(bytes(_aligned(position) - position))
        write(array.reshape(-1).view(np.uint8).data)
    # Padding before the next array and before the checksum, so that everything is aligned.
    write(bytes(_aligned(position) - position))
    file.write(digest.digest())


def _read(path: Path, most: int = sys.maxsize) -> bytearray:
    try:
        with open(path, "rb") as file:
            content = bytearray(min(os.fstat(file.fileno()).st_size, most))
            file.readinto(content)
    except OSError as error:
        raise StorageError(f"Cannot read checkpoint {path}: {error.strerror}.") from error
    return content


def _aligned(position: int) -> int:
    return -(-position // ALIGNMENT) * ALIGNMENT
