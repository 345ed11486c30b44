"""TensorBoard's own reader finds the metrics of each committed generation once, whatever happened to the files."""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.event_file import EventFile, write_events
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import Generation
from repertoires import make

STARTED = 2


@pytest.fixture
def generations(tmp_path: Path) -> list[Generation]:
    make(tmp_path / "repertoire.db")
    with Repertoire.open(tmp_path / "repertoire.db", read_only=True) as repertoire:
        found = repertoire.generations()
    assert len(found) > STARTED + 1
    return found


def refuse(words: str) -> None:
    pytest.fail(words)


def write(folder: Path, generations: list[Generation], stored: int) -> None:
    """Write events as a run does that starts with some generations and commits the others."""
    file = EventFile(folder, generations[:stored], refuse)
    for generation in generations[stored:]:
        file.append(generation)
    file.close()


def series(folder: Path) -> dict[str, list[tuple[int, float, float]]]:
    """Return step, value and time of each number, by tag, as TensorBoard shows them."""
    events = EventAccumulator(str(folder), size_guidance={"scalars": 0}).Reload()
    tags = events.Tags()["scalars"]
    return {tag: [(e.step, e.value, e.wall_time) for e in events.Scalars(tag)] for tag in tags}


def expected(generations: list[Generation], name: str) -> list[tuple[int, float]]:
    return [(g.metrics.evaluations, float(getattr(g.metrics, name))) for g in generations]


@pytest.mark.parametrize("name", ["qd_score", "coverage", "max_fitness", "min_fitness"])
def test_each_generation_is_there_once_with_its_number(
    tmp_path: Path, generations: list[Generation], name: str
) -> None:
    write(tmp_path, generations, STARTED)
    found = [entry[:2] for entry in series(tmp_path)[f"archive/{name}"]]
    assert [step for step, _ in found] == [step for step, _ in expected(generations, name)]
    np.testing.assert_allclose(found, expected(generations, name), rtol=1e-6)


def test_operators_that_made_something_are_counted(
    tmp_path: Path, generations: list[Generation]
) -> None:
    write(tmp_path, generations, 0)
    found = series(tmp_path)
    for index, operator in enumerate(Operator):
        made = [g for g in generations if g.metrics.offspring[index]]
        counts = [(g.metrics.evaluations, float(g.metrics.new_elites[index])) for g in made]
        assert [e[:2] for e in found.get(f"new_elites/{operator.label}", [])] == counts
    assert any(tag.startswith("new_elites/") for tag in found)


def test_a_resumed_run_has_every_step_once(tmp_path: Path, generations: list[Generation]) -> None:
    write(tmp_path, generations, 0)
    written_in_one_go = series(tmp_path)
    write(tmp_path, generations[:-1], STARTED)  # killed before it committed the last generation
    write(tmp_path, generations, len(generations) - 1)
    assert series(tmp_path) == written_in_one_go


def test_a_finished_run_gets_all_of_its_events(
    tmp_path: Path, generations: list[Generation]
) -> None:
    write_events(tmp_path / "repertoire.db", refuse)
    found = [entry[:2] for entry in series(tmp_path)["archive/coverage"]]
    assert found == expected(generations, "coverage")


def test_files_of_others_stay(tmp_path: Path, generations: list[Generation]) -> None:
    other = tmp_path / "events.out.tfevents.1.mine"
    other.touch()
    write(tmp_path, generations, 0)
    assert other.exists()


@contextmanager
def full_disk(size: int) -> Iterator[None]:
    """Let no file grow beyond some bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_told_once_and_stops_nothing(
    tmp_path: Path, generations: list[Generation]
) -> None:
    told: list[str] = []
    file = EventFile(tmp_path, generations[:STARTED], told.append)
    (path,) = tmp_path.glob("events.out.tfevents.*")
    with full_disk(path.stat().st_size):
        for generation in generations[STARTED:]:
            file.append(generation)
    file.close()
    assert len(told) == 1
    assert "left out until the next start" in told[0]
    assert "\n" not in told[0]
    kept = [entry[:2] for entry in series(tmp_path)["archive/coverage"]]
    assert kept == expected(generations[:STARTED], "coverage")


def test_a_folder_that_cannot_be_written_is_told(
    tmp_path: Path, generations: list[Generation]
) -> None:
    told: list[str] = []
    EventFile(tmp_path / "absent", generations, told.append).append(generations[0])
    assert len(told) == 1


def test_the_writer_loads_no_heavy_package(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from pga_me_ros.core.storage.event_file import EventFile;"
        "assert 'tensorboard' not in sys.modules; EventFile(Path(sys.argv[1]), [], print).close();"
        "print(sorted({'tensorboard', 'torch', 'grpc', 'PIL', 'matplotlib'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "['tensorboard']\n"), done.stderr
