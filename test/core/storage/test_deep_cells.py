"""Cells with several solutions in a repertoire file: read back as they were, and every damage is told."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.depth import CellDepth
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire, RunInfo
from pga_me_ros.errors import StorageError
from pga_me_ros.tasks.registry import task_spec

DEPTH = 3
SETTINGS = Settings(
    task="qd_hopper",
    cells=5,
    cvt_samples=100,
    controller_hidden=(2,),
    batch_size=10,
    n_evo=5,
    extract_share=0.3,
    cell_depth=DEPTH,
)
SPEC = task_spec("qd_hopper")


def batch(deep: CellDepth, generation: int) -> Solutions:
    """Return a made-up generation: 7 new solutions, and 3 that are evaluated again."""
    rng = np.random.default_rng(generation)
    again = deep.draw(0, generation, 3) if generation else np.empty(0, np.int64)
    n = 10
    new = n - len(again)
    parameters = rng.standard_normal((n, deep.archive.parameter_count)).astype(np.float32)
    parents = np.full((n, 2), -1)
    if len(again):
        parameters[new:] = deep.parameters(again)
        parents[new:, 0] = again
    return Solutions.of(
        fitness=rng.integers(0, 50, n) / 7.0,
        descriptors=rng.random((n, 1)),
        parameters=parameters,
        evaluations=range(n * generation, n * generation + n),
        generation=generation,
        operators=[Operator.GA] * new + [Operator.EXTRACTED] * len(again),
        parents=parents,
    )


def grow(file: Repertoire, archive: Archive, deep: CellDepth, generations: range) -> None:
    """Add made-up generations to an archive and its file."""
    metrics: Metrics | None = file.metrics()[-1] if generations.start else None
    for generation in generations:
        solutions = batch(deep, generation)
        change = deep.add(solutions, np.ones(len(solutions), np.bool_))
        metrics = generation_metrics(archive, solutions, change.added, generation, metrics)
        elites = [archive.elite(cell) for cell in change.changed_cells.tolist()]
        assert file.commit(generation, elites, metrics, {}, change)


def same(one: CellDepth, other: CellDepth) -> bool:
    """Whether two archives hold the same, bit for bit, below their elites, too."""

    def bits(deep: CellDepth) -> object:
        below = {c: [s.to_bytes() for s in ss] for c, ss in sorted(deep.below.items())}
        samples = {k: (s.count, s.fitness, s.descriptor.tobytes()) for k, s in deep.samples.items()}
        return deep.archive.digest(), below, samples

    return bits(one) == bits(other)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file of four generations."""
    path = tmp_path / "repertoire.db"
    archive = make_archive(SPEC, SETTINGS)
    info = RunInfo.of_new_run(SPEC, SETTINGS)
    with Repertoire.create(path, info, archive) as file:
        grow(file, archive, CellDepth(archive, DEPTH), range(4))
    return path


def test_what_is_read_back_grows_on_as_what_was_stored(path: Path) -> None:
    whole = make_archive(SPEC, SETTINGS)
    expected = CellDepth(whole, DEPTH)
    for generation in range(7):
        solutions = batch(expected, generation)
        expected.add(solutions, np.ones(len(solutions), np.bool_))
    with Repertoire.open(path) as file:
        archive = file.load_archive()
        deep = file.load_depth(archive, DEPTH)
        assert deep.below
        assert max(s.count for s in deep.samples.values()) > 1
        grow(file, archive, deep, range(4, 7))
        assert same(deep, expected)
        again = file.load_archive()
        assert same(file.load_depth(again, DEPTH), expected)


def test_a_generation_is_committed_once(path: Path) -> None:
    with Repertoire.open(path) as file:
        archive = file.load_archive()
        deep = file.load_depth(archive, DEPTH)
        before = file.result_digest()
        metrics = file.metrics()[-1]
        assert not file.commit(3, [], metrics, {})
        assert (file.result_digest(), same(file.load_depth(archive, DEPTH), deep)) == (before, True)


def test_a_file_without_generations_has_nothing_below(tmp_path: Path) -> None:
    path = tmp_path / "repertoire.db"
    archive = make_archive(SPEC, SETTINGS)
    with Repertoire.create(path, RunInfo.of_new_run(SPEC, SETTINGS), archive) as file:
        deep = file.load_depth(file.load_archive(), DEPTH)
    assert (deep.below, deep.samples) == ({}, {})


def drop_a_solution(connection: sqlite3.Connection) -> None:
    connection.execute("DELETE FROM below WHERE evaluation = (SELECT max(evaluation) FROM below)")


def change_a_sum(connection: sqlite3.Connection) -> None:
    connection.execute("UPDATE samples SET fitness = fitness + 1")


def drop_the_digest(connection: sqlite3.Connection) -> None:
    connection.execute("DELETE FROM deep_generations WHERE generation = 3")


@pytest.mark.parametrize("harm", [drop_a_solution, change_a_sum, drop_the_digest])
def test_damage_is_told(path: Path, harm: Callable[[sqlite3.Connection], None]) -> None:
    with sqlite3.connect(path) as connection:
        harm(connection)
    connection.close()
    with Repertoire.open(path, read_only=True) as file:
        archive = file.load_archive()
        with pytest.raises(StorageError, match=r"is damaged: (the evaluations of|what its cells)"):
            file.load_depth(archive, DEPTH)
