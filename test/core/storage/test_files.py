"""Files are replaced completely or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

import pytest

from pga_me_ros.core.storage.files import rename_file, replace_file, save_bytes
from pga_me_ros.errors import StorageError


@pytest.mark.parametrize("shared", [False, True])
def test_a_file_is_replaced_and_no_other_file_is_left(tmp_path: Path, shared: bool) -> None:
    file = tmp_path / "table.csv"
    for content in (b"old", b"new"):
        replace_file(file, content, shared=shared)
        assert file.read_bytes() == content
    assert os.listdir(tmp_path) == ["table.csv"]


def test_content_may_be_written_in_parts(tmp_path: Path) -> None:
    def write(file: BinaryIO) -> None:
        file.write(b"one ")
        file.write(b"two")

    replace_file(tmp_path / "parts", write)
    assert (tmp_path / "parts").read_bytes() == b"one two"


def test_if_writing_fails_the_old_file_stays(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    replace_file(file, b"old")

    def write(new: BinaryIO) -> None:
        new.write(b"half")
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        replace_file(file, write)
    assert file.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["table.csv"]


def test_leftovers_of_a_killed_process_are_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"

    def die(new: BinaryIO) -> None:
        new.write(b"half of a much longer file")
        new.flush()
        os._exit(0)

    child = os.fork()
    if child == 0:
        replace_file(file, die)
    os.waitpid(child, 0)
    assert len(os.listdir(tmp_path)) == 1
    assert not file.exists()
    replace_file(file, b"whole")
    assert os.listdir(tmp_path) == ["table.csv"]
    assert file.read_bytes() == b"whole"


def test_content_and_folder_are_synced_to_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        synced.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    replace_file(tmp_path / "a", b"content")
    assert synced == [str(tmp_path / ".a.new"), str(tmp_path)]
    rename_file(tmp_path / "a", tmp_path / "b")
    assert synced[2:] == [str(tmp_path)]
    assert (tmp_path / "b").read_bytes() == b"content"


def test_a_file_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"cannot be written .* check the folder"):
        save_bytes(tmp_path / "missing" / "file", b"")
