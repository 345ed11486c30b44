"""The file of an adapter: what it may be."""

from __future__ import annotations

import re
import shutil
import sqlite3
from pathlib import Path

import pytest

from pga_me_ros.adapting.memory import Memory, Undertaking
from pga_me_ros.core.storage.shipped import REPERTOIRE, shipped
from pga_me_ros.errors import StorageError


def foreign(path: Path) -> None:
    """Write a file of another program."""
    file = sqlite3.connect(path)
    file.execute("CREATE TABLE trial (id INTEGER)")
    file.execute("CREATE TABLE patients (id INTEGER)")
    file.close()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda path: shutil.copyfile(shipped()["qd_hopper"] / REPERTOIRE, path),
            "is no memory of an adapter: it is a SQLite file with ",
        ),
        (foreign, "is no memory of an adapter: it is a SQLite file with patients; name a memory"),
        (lambda path: path.write_text("mine" * 100), "file is not a database"),
    ],
    ids=["repertoire", "foreign", "text"],
)
def test_another_file_is_refused_and_left_as_it_is(tmp_path: Path, make, words: str) -> None:
    path = tmp_path / "mine.db"
    make(path)
    before = path.read_bytes()
    with pytest.raises(StorageError, match=re.escape(words)):
        Memory(path)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("mine.db", before)]


@pytest.mark.parametrize("there", [False, True])
def test_a_new_or_empty_file_becomes_a_memory(tmp_path: Path, there: bool) -> None:
    path = tmp_path / "memory.db"
    if there:
        path.touch()
    memory = Memory(path)
    begun = memory.start(Undertaking("run", "qd_hopper", 5, -1e308, -1.0))
    memory.close()
    assert Memory(path).last() == (begun, [])
