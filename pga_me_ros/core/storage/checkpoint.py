"""Checkpoint files: named arrays and some JSON in one file that is whole or refused.

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
"""Bytes at the beginning of a file that hold its header in any case."""

PLAIN_KINDS = "biuf"
"""Array kinds that a file may hold: booleans, integers, floats; never objects."""


def save_checkpoint(path: str | Path, arrays: Mapping[str, Array], meta: Mapping[str, Any]) -> None:
    """Write a checkpoint in the place of an older one; a crash leaves one of the two, whole.

    Args:
        path: File to write.
        arrays: Arrays of booleans, integers or floats, of any shape.
        meta: What JSON can hold.

    Raises:
        StorageError: The file cannot be written, or an array or `meta` is of a kind that it cannot
            hold.
    """
    path = Path(path)
    plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    header = _header(path, arrays, plain, meta)
    try:
        replace_file(path, lambda file: _write_content(file, header, plain))
    except OSError as error:
        raise StorageError(
            f"Cannot write checkpoint {path}: {error.strerror}. "
            "Make room on its disk, or give a folder that exists and may be written to."
        ) from error


def load_checkpoint(path: str | Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read a checkpoint and make sure that it is whole.

    Args:
        path: File that `save_checkpoint` wrote.

    Returns:
        The arrays by name, writable, and the meta data.

    Raises:
        StorageError: The file cannot be read, is no checkpoint, or is damaged; the message names
            it.
    """
    path = Path(path)
    content = _read(path)
    _require_magic(path, bytes(content[: len(MAGIC)]))
    body = memoryview(content)[:-DIGEST_SIZE]
    if hashlib.sha256(body).digest() != content[-DIGEST_SIZE:]:
        raise StorageError(
            f"Checkpoint {path} is damaged: its checksum does not match, so it was cut short or "
            "changed. Restore it from a copy, or start the run anew."
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
    """Return the shapes of a checkpoint's arrays by name, without reading them or checking its sum.

    Raises:
        StorageError: The file cannot be read, is no checkpoint, or its header is damaged.
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
            "start the run anew."
        ) from None


def _require_magic(path: Path, found: bytes) -> None:
    if found == MAGIC:
        return
    if found[:-1] == MAGIC[:-1] and len(found) == len(MAGIC):
        raise StorageError(
            f"Checkpoint {path} has version {found[-1:].decode(errors='replace')!r} of the layout, this "
            f"program reads {MAGIC[-1:].decode()!r}. Use the pga_me_ros that made it."
        )
    raise StorageError(
        f"{path} is no checkpoint of this program, or its beginning is damaged. Restore it from a "
        "copy, or start the run anew."
    )


def _header(
    path: Path, arrays: Mapping[str, Array], plain: Mapping[str, Array], meta: Mapping[str, Any]
) -> bytes:
    entries = []
    for name, array in plain.items():
        if array.dtype.kind not in PLAIN_KINDS:
            raise StorageError(
                f"Array '{name}' of {array.dtype} cannot go into checkpoint {path}; "
                "it holds booleans, integers and floats only."
            )
        # ascontiguousarray makes a scalar one-dimensional, so the shape is the original's.
        shape = list(np.shape(arrays[name]))
        entries.append({"name": name, "dtype": array.dtype.str, "shape": shape})
    try:
        return json.dumps({"arrays": entries, "meta": dict(meta)}).encode()
    except TypeError as error:
        raise StorageError(f"Meta data of checkpoint {path} is no JSON: {error}.") from error


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
    # The next array's padding, so that a reader finds every array at an aligned place, the end
    # included.
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
