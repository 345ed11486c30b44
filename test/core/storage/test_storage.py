"""The repertoire file: everything stored is read back, generation by generation."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.metrics import generation_metrics
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import StorageError
from repertoires import INFO, RATES, P, empty, generations, grow, make

SERVE = """
import sys
from pga_me_ros.core.storage.repertoire import Repertoire
with Repertoire.open(sys.argv[1], read_only=True) as repertoire:
    print(repertoire.load_archive().best().parameters.shape)
print(sorted({"torch", "pybullet", "rclpy", "scipy", "ribs"} & set(sys.modules)))
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run" / "repertoire.db"


@pytest.mark.parametrize("kind", ["cvt", "grid"])
def test_an_archive_is_read_back_bit_for_bit(path: Path, kind: str) -> None:
    archive = make(path, kind=kind)
    with Repertoire.open(path, read_only=True) as repertoire:
        assert repertoire.load_archive().digest() == archive.digest()


def test_centroids_are_read_back_bit_for_bit(path: Path) -> None:
    archive = make(path, count=0)
    with Repertoire.open(path, read_only=True) as repertoire:
        assert repertoire.load_archive().centroids.tobytes() == archive.centroids.tobytes()


def test_metrics_are_read_back(path: Path) -> None:
    with Repertoire.create(path, INFO, empty()) as repertoire:
        grow(repertoire, empty(), 4)
        expected = [metrics for _, _, metrics in generations(empty(), 4)]
        assert repertoire.metrics() == expected


def test_rates_are_read_back(path: Path) -> None:
    make(path, count=2)
    with Repertoire.open(path, read_only=True) as repertoire:
        assert repertoire.rates() == [RATES, RATES]


def test_the_description_is_read_back(path: Path) -> None:
    make(path, count=0)
    with Repertoire.open(path, read_only=True) as repertoire:
        assert repertoire.info == INFO


@pytest.mark.parametrize("count", [0, 1, 3])
def test_last_generation_counts_from_zero(path: Path, count: int) -> None:
    make(path, count)
    with Repertoire.open(path, read_only=True) as repertoire:
        assert repertoire.last_generation == count - 1


def test_a_run_continues_as_if_it_had_never_stopped(path: Path, tmp_path: Path) -> None:
    make(path, 2)
    archive = empty()
    with Repertoire.open(path) as repertoire:
        for generation, elites, metrics in generations(archive, 5):
            if generation > 1:
                repertoire.commit(generation, elites, metrics, RATES)
        digest = repertoire.result_digest()
    whole = make(tmp_path / "whole.db", 5)
    assert digest == whole.digest()


def test_committing_a_generation_again_returns_false(path: Path) -> None:
    with Repertoire.create(path, INFO, empty()) as repertoire:
        first, *_ = generations(empty(), 2)
        answers = [repertoire.commit(*first, RATES) for _ in range(2)]
    assert answers == [True, False]


def test_committing_a_generation_again_changes_nothing(path: Path) -> None:
    archive = make(path, 3)
    first, *_ = generations(empty(), 1)
    with Repertoire.open(path) as repertoire:
        repertoire.commit(*first, RATES)
        assert repertoire.result_digest() == archive.digest()


def test_a_skipped_generation_is_refused(path: Path) -> None:
    _, second, *_ = generations(empty(), 2)
    with (
        Repertoire.create(path, INFO, empty()) as repertoire,
        pytest.raises(StorageError, match="next is 0, not 1"),
    ):
        repertoire.commit(*second, RATES)


def test_a_forgotten_elite_is_refused(path: Path) -> None:
    generation, elites, metrics = next(generations(empty(), 1))
    with (
        Repertoire.create(path, INFO, empty()) as repertoire,
        pytest.raises(StorageError, match="commit those of all changed cells"),
    ):
        repertoire.commit(generation, elites[1:], metrics, RATES)


def test_metrics_that_are_not_finite_are_refused(path: Path) -> None:
    generation, elites, metrics = next(generations(empty(), 1))
    broken = dataclasses.replace(metrics, qd_score=float("nan"))
    with (
        Repertoire.create(path, INFO, empty()) as repertoire,
        pytest.raises(StorageError, match="must be finite"),
    ):
        repertoire.commit(generation, elites, broken, RATES)


def test_a_reader_sees_each_commit_of_a_writer(path: Path) -> None:
    seen = []
    with (
        Repertoire.create(path, INFO, empty()) as writer,
        Repertoire.open(path, read_only=True) as reader,
    ):
        for generation in generations(empty(), 3):
            writer.commit(*generation, RATES)
            seen.append(len(reader.load_archive()) == generation[2].coverage)
    assert seen == [True] * 3


def test_a_reader_may_not_commit(path: Path) -> None:
    make(path, 0)
    first, *_ = generations(empty(), 1)
    with (
        Repertoire.open(path, read_only=True) as repertoire,
        pytest.raises(StorageError, match="opened for reading"),
    ):
        repertoire.commit(*first, RATES)


def test_the_digest_does_not_depend_on_run_path_or_time(path: Path, tmp_path: Path) -> None:
    make(path)
    other = dataclasses.replace(INFO, run_id="another", created="2030-01-01T00:00:00+00:00")
    digests = set()
    with Repertoire.create(tmp_path / "other.db", other, empty()) as repertoire:
        grow(repertoire, empty(), 4)
        digests.add(repertoire.result_digest())
    with Repertoire.open(path) as repertoire:
        digests.add(repertoire.result_digest())
    assert len(digests) == 1


def test_a_closed_file_is_one_file(path: Path) -> None:
    make(path)
    assert sorted(p.name for p in path.parent.iterdir()) == ["repertoire.db", "repertoire.db.lock"]


def test_serving_needs_neither_torch_nor_pybullet(path: Path) -> None:
    make(path)
    output = subprocess.run(
        [sys.executable, "-c", SERVE, str(path)], capture_output=True, text=True, check=True
    ).stdout
    assert output.split("\n")[:2] == ["(50,)", "[]"]


def test_a_run_with_other_rates_and_budget_may_resume() -> None:
    INFO.require(Settings(n_evo=10, evaluations=5), INFO.task)


@pytest.mark.parametrize(
    ("settings", "task", "message"),
    [
        (Settings(seed=1), INFO.task, "seed: 0 != 1"),
        (Settings(), {**INFO.task, "name": "qd_ant"}, "task name: qd_walker != qd_ant"),
    ],
)
def test_another_run_may_not_resume(settings: Settings, task: dict, message: str) -> None:
    with pytest.raises(StorageError, match=message):
        INFO.require(settings, task)


def test_other_library_versions_are_named() -> None:
    assert INFO.version_differences({"numpy": "3.0"}) == ["numpy: 2.4.6 != 3.0"]


def test_a_description_survives_conversion_to_json() -> None:
    assert RunInfo.from_json(INFO.to_json()) == INFO


def test_tied_centroids_keep_their_index(path: Path) -> None:
    twins = CvtArchive([[0.5, 0.5], [0.5, 0.5]], [0, 0], [1, 1], 50)
    Repertoire.create(path, INFO, twins).close()
    with Repertoire.open(path) as repertoire:
        assert repertoire.load_archive().cell_of([[0.1, 0.1]]).tolist() == [0]


def test_every_controller_that_was_the_best_one_is_kept(tmp_path: Path) -> None:
    archive, before, bests = GridArchive((4,), [0.0], [1.0], P), None, []
    with Repertoire.create(tmp_path / "repertoire.db", INFO, archive) as repertoire:
        for generation, (fitness, where) in enumerate([(1, 0.1), (2, 0.1), (1, 0.9), (3, 0.1)]):
            batch = Solutions.of(
                fitness=[fitness],
                descriptors=[[where]],
                parameters=np.full((1, P), generation),
                evaluations=[generation],
                generation=generation,
            )
            added = archive.add(batch)
            before = generation_metrics(archive, batch, added, generation, before)
            elites = [archive.elite(cell) for cell in added.changed_cells]
            repertoire.commit(generation, elites, before, RATES)
            bests.append(archive.best().to_bytes())
        kept = {best.evaluation: best.to_bytes() for best in repertoire.bests()}
        assert [m.best_evaluation for m in repertoire.metrics()] == [0, 1, 1, 3]
    # Two of them were replaced in their cell by the next one.
    assert kept == {0: bests[0], 1: bests[1], 3: bests[3]}


def as_an_older_program_left_it(path: Path) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("DROP TABLE extremes")
        connection.execute("DROP TABLE bests")


def test_a_file_of_an_older_version_is_read_and_continued(tmp_path: Path) -> None:
    path = tmp_path / "repertoire.db"
    make(path, 3)
    as_an_older_program_left_it(path)
    with Repertoire.open(path, read_only=True) as repertoire:
        older = repertoire.metrics()
        assert [math.isnan(m.min_fitness) for m in older] == [True] * 3
        assert [m.best_evaluation for m in older] == [-1] * 3
        assert repertoire.bests() == []
    *_, (generation, elites, metrics) = generations(archive := empty(), 4)
    with Repertoire.open(path) as repertoire:
        repertoire.commit(generation, elites, metrics, RATES)
        assert repertoire.metrics()[-1] == metrics
        (best,) = repertoire.bests()
    assert best.to_bytes() == archive.best().to_bytes()
    assert (
        best.generation < generation
    )  # it was the best one before the file was opened, and is kept


WIDE = (0.0, 0.0), (1.0, 1000.0)


def wide(scaled: bool = True) -> CvtArchive:
    """Return an archive whose cells depend on how distances are measured."""
    centroids = np.random.default_rng(1).random((12, 2)) * WIDE[1]
    return CvtArchive(centroids, *WIDE, P, scaled=scaled)


@pytest.mark.parametrize("version", [1, 2])
def test_a_files_version_decides_how_distances_are_measured(path: Path, version: int) -> None:
    archive = wide(scaled=version == 2)
    info = dataclasses.replace(INFO, schema_version=version)
    Repertoire.create(path, info, archive).close()
    descriptors = np.random.default_rng(2).random((200, 2)) * WIDE[1]
    for read_only in (False, True):
        with Repertoire.open(path, read_only) as repertoire:
            found = repertoire.load_archive()
        np.testing.assert_array_equal(found.cell_of(descriptors), archive.cell_of(descriptors))
        assert bool(found.note) == (version == 1)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (version,)


def test_a_new_file_has_cells_in_shares_of_the_range() -> None:
    assert INFO.schema_version == 2
    descriptors = np.random.default_rng(2).random((200, 2)) * WIDE[1]
    assert (wide().cell_of(descriptors) != wide(scaled=False).cell_of(descriptors)).any()
