"""Documented commands, taken from a page and run unchanged in a separate ROS domain."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 120.0

TINY = (
    "-p evaluations:=30 -p random_init:=10 -p batch_size:=10 -p n_evo:=5 -p n_grad:=2 -p n_crit:=10 "
    "-p transition_batch:=32 -p cells:=64 -p cvt_samples:=2000 -p controller_hidden:=[16] "
    "-p critic_hidden:=[16] -p evaluators:=1 -p serve:=false -p discovery_wait:=0.0"
)
"""Makes the run of a documented command last only seconds; later arguments override earlier ones."""


def blocks(page: str, language: str = "") -> list[str]:
    """Return the code blocks of a language in a page of docs/."""
    text = (ROOT / "docs" / page).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


class Shell:
    """Runs commands in one folder and one ROS domain."""

    def __init__(self, domain: int, folder: Path) -> None:
        self.folder = folder
        self._environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}",
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        (folder / "config").symlink_to(ROOT / "config")

    def run(self, command: str) -> str:
        """Run a command to its end; return its output."""
        with self.started(command) as process:
            output, _ = process.communicate(timeout=SECONDS)
        assert process.returncode == 0, output
        return output

    @contextmanager
    def started(self, command: str) -> Iterator[subprocess.Popen[str]]:
        """Start a command; end it and its children afterwards."""
        process = subprocess.Popen(
            ["bash", "-c", command],
            cwd=self.folder,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
                try:
                    process.communicate(timeout=10.0)
                except subprocess.TimeoutExpired:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.communicate()
