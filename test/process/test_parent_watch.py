"""A child ends when its parent does, from the moment it starts."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from pga_me_ros.process.parent_watch import EXIT_ORPHANED, PARENT_WATCH

STARTING = """
import threading
import pga_me_ros.nodes

print("starting", flush=True)
threading.Event().wait()  # as long as an import may take
"""


@pytest.mark.parametrize("before", ["", "import rclpy"], ids=["no-ROS-yet", "ROS"])
def test_a_child_whose_parent_dies_while_it_imports_its_libraries_ends(before: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", before + STARTING],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, PARENT_WATCH: "1"},
    ) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.readline() == b"starting\n"
        process.stdin.close()
        assert process.wait() == EXIT_ORPHANED
