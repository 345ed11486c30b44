"""A run of the graph for `chaos.py`: start it, observe it, kill its processes. Not a bench itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from _run_times import committed

from pga_me_ros.core.storage.repertoire import Repertoire

POLL = 0.02
"""Seconds between two checks on other processes, which send no events."""

PATIENCE = 180.0
"""Seconds without progress after which a run counts as stuck."""

ORPHAN_LIMIT = 5.0
"""Seconds within which the children of a killed orchestrator must be gone."""


class ChaosError(Exception):
    """The run broke a promise."""


class ChaosRun:
    """One run directory and the command that starts and resumes its run.

    Args:
        folder: Folder of the run.
        parameters: ROS parameters of the orchestrator.
        domain: ROS domain used by this run only.
    """

    def __init__(self, folder: Path, parameters: Mapping[str, Any], domain: int) -> None:
        self.folder = folder
        self._output = folder.with_suffix(".txt")
        self._command = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator", "--ros-args"]
        for name, value in {**parameters, "run_dir": folder}.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            self._command += ["-p", f"{name}:={text}"]
        self._environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def process(self) -> subprocess.Popen[bytes]:
        """The orchestrator's process."""
        assert self._process is not None, "start the run first"
        return self._process

    @property
    def generations(self) -> int:
        """Number of committed generations."""
        return len(committed(self.folder / "repertoire.db"))

    @property
    def output(self) -> str:
        """All output of this run's orchestrators."""
        return self._output.read_text(errors="replace")

    def start(self) -> None:
        """Start the run, or resume it; the command is the same."""
        with self._output.open("ab") as file:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=self._environment,
            )

    def children(self) -> dict[str, int]:
        """Return the process ids of all living children by node name, orphans included."""
        mark = f"{self.folder}/parameters/"
        found = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    words = (entry / "cmdline").read_bytes().decode().split("\0")
                except OSError:
                    continue  # it has ended
                name = next((w.split(":=")[1] for w in words if w.startswith("__node:=")), "")
                if name and any(w.startswith(mark) for w in words):
                    found[name] = int(entry.name)
        return found

    def wait_until(self, true: Callable[[], Any], what: str) -> None:
        """Wait for a condition during the run.

        Raises:
            ChaosError: The condition does not come true, or the run has ended.
        """
        deadline = time.monotonic() + PATIENCE
        while not true():
            if self.process.poll() is not None:
                raise ChaosError(
                    f"ended with {self.process.returncode} before {what}:\n{self.output}"
                )
            if time.monotonic() > deadline:
                raise ChaosError(f"waited {PATIENCE:.0f} s for {what}:\n{self.output}")
            time.sleep(POLL)

    def wait_for_generation(self, generation: int) -> None:
        """Wait until this many generations are committed."""
        self.wait_until(lambda: self.generations >= generation, f"generation {generation}")

    def send(self, name: str, number: signal.Signals) -> int:
        """Send a signal to a child as soon as it exists, and return its process id."""
        self.wait_until(lambda: name in self.children(), f"a living {name}")
        pid = self.children().get(name)
        if pid is None:  # it ended between two checks
            return self.send(name, number)
        os.kill(pid, number)
        return pid

    def kill_orchestrator(self, *, with_children: bool) -> float:
        """Kill the orchestrator with SIGKILL, with or without its children.

        Returns:
            Seconds until no child was left.

        Raises:
            ChaosError: A child is left after `ORPHAN_LIMIT`.
        """
        others = list(self.children().values()) if with_children else []
        for pid in [self.process.pid, *others]:
            os.kill(pid, signal.SIGKILL)
        killed = time.monotonic()
        self.process.wait()
        while left := self.children():
            if time.monotonic() - killed > ORPHAN_LIMIT:
                raise ChaosError(f"left {ORPHAN_LIMIT:.0f} s after the orchestrator: {left}")
            time.sleep(POLL)
        return time.monotonic() - killed

    def finish(self) -> str:
        """Wait for the end of the run and return the digest of its repertoire.

        Raises:
            ChaosError: The run fails, gets stuck or leaves processes behind.
        """
        self.wait_until(lambda: self.process.poll() == 0, "its end")
        if left := self.children():
            raise ChaosError(f"a finished run left {left}")
        with Repertoire.open(self.folder / "repertoire.db", read_only=True) as repertoire:
            return repertoire.result_digest()

    def end(self) -> None:
        """End all processes, whatever happened."""
        for pid in self.children().values():
            os.kill(pid, signal.SIGKILL)
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()
