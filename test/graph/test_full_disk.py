"""A disk that becomes full during a run: one clear line, nothing lost, and the run resumes when there is space."""

from __future__ import annotations

import contextlib
import csv
import resource
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from graph import Graph, Started
from processes import children, wait_for_no_children
from reference import run_digest, search_digest, search_metrics

from pga_me_ros.core.storage.metrics_file import MetricsFile
from pga_me_ros.core.storage.repertoire import Repertoire

LONG: dict[str, Any] = {"evaluations": 60, "n_crit": 50}
ERROR = 2


class LimitedFiles:
    """A limit that keeps a run's children from writing beyond the first byte of any file, like an exhausted quota."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fill(self, run: Started) -> None:
        """Set the limit for the present processes."""
        for pid in children(self.folder / "run").values():
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))

    def make_room(self) -> None:
        """Do nothing: new processes are not limited."""


class SmallDisk:
    """A file system of a few megabytes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fill(self, run: Started) -> None:
        """Use up all free space."""
        with contextlib.suppress(OSError), (self.folder / "filling").open("wb", 0) as file:
            while True:
                file.write(bytes(4096))

    def make_room(self) -> None:
        """Delete the file that fills it."""
        (self.folder / "filling").unlink()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[LimitedFiles | SmallDisk]:
    """Return a disk that can be filled: a real one if mounting is allowed, else a limit of the kernel."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(folder)]
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode:
        yield LimitedFiles(tmp_path)
        return
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_full_disk_ends_the_run_which_resumes_when_there_is_space(
    graph: Graph, disk: LimitedFiles | SmallDisk
) -> None:
    run_dir = disk.folder / "run"
    run = graph.run(run_dir, **LONG)
    run.wait_for_output("generation 2/")
    disk.fill(run)
    assert run.wait() == ERROR, run.output
    (error,) = [line for line in run.output.splitlines() if line.startswith("error: ")]
    assert "Traceback" not in run.output
    assert (
        "Free space on its disk" in error
        or "free some space" in error
        or "the space on it" in error
    ), error
    assert str(run_dir) in error
    assert f"evaluations are safe in {run_dir}/repertoire.db" in run.output
    wait_for_no_children(run_dir)
    disk.make_room()
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        assert repertoire.last_generation >= 1
        assert repertoire.metrics() == search_metrics(**LONG)[: repertoire.last_generation + 1]
    again = graph.run(run_dir, **LONG)
    assert again.wait() == 0, again.output
    assert run_digest(run_dir) == search_digest(**LONG)
    assert_table_is_that_of_an_undisturbed_run(run_dir)


def assert_table_is_that_of_an_undisturbed_run(run_dir: Path) -> None:
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        generations = repertoire.generations()
    rebuilt = MetricsFile(run_dir / "rebuilt.csv")
    rebuilt.rebuild(generations)
    content = (run_dir / "metrics.csv").read_text()
    assert content == rebuilt.path.read_text()
    qd_scores = [float(row["qd_score"]) for row in csv.DictReader(content.splitlines())]
    assert qd_scores == [m.qd_score for m in search_metrics(**LONG)]
