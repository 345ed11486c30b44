"""Garbage collection, off during imports, is on again once a node starts."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator

import pytest

from pga_me_ros.process.collection import pause_collection, resume_collection

NODE = """
import gc
import sys

sys.orig_argv, sys.argv = ["python", "-m", "pga_me_ros.nodes.record"], ["-m"]  # as when Python imports it for -m
import pga_me_ros
print(gc.isenabled())
sys.argv = ["record", "--help"]
from pga_me_ros.nodes.record import main
main()
print(gc.isenabled())
"""


@pytest.fixture(autouse=True)
def collecting() -> Iterator[None]:
    yield
    gc.unfreeze()
    gc.enable()


def test_what_was_there_before_is_never_looked_at() -> None:
    pause_collection()
    assert not gc.isenabled()
    resume_collection()
    assert gc.isenabled()
    frozen = gc.get_freeze_count()
    assert frozen > 1000
    later = [[] for _ in range(1000)]
    resume_collection()
    assert gc.get_freeze_count() <= frozen  # some may have been freed since
    assert len(later) == 1000


def test_it_is_off_while_a_node_imports_its_libraries_and_on_once_it_starts() -> None:
    done = subprocess.run([sys.executable, "-c", NODE], capture_output=True, text=True, check=True)
    first, *help_text, last = done.stdout.splitlines()
    assert (first, last) == ("False", "True")
    assert help_text[0].startswith("Usage: record")
