"""metrics.csv holds exactly the committed generations, whatever happened to the file."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest

from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.metrics_file import COLUMNS, TIME_COLUMNS, MetricsFile
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import Generation
from pga_me_ros.errors import StorageError
from repertoires import make

DOCUMENT = Path(__file__).parents[3] / "docs" / "reliability.md"


@pytest.fixture
def generations(tmp_path: Path) -> list[Generation]:
    make(tmp_path / "repertoire.db")
    with Repertoire.open(tmp_path / "repertoire.db", read_only=True) as repertoire:
        return repertoire.generations()


@pytest.fixture
def table(tmp_path: Path, generations: list[Generation]) -> MetricsFile:
    """Return a file that has grown row by row."""
    table = MetricsFile(tmp_path / "metrics.csv")
    table.rebuild([])
    for generation in generations:
        table.append(generation)
    return table


def test_every_number_is_read_back_bit_for_bit(
    table: MetricsFile, generations: list[Generation]
) -> None:
    with table.path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    for row, generation in zip(rows, generations, strict=True):
        metrics = generation.metrics
        assert float(row["qd_score"]) == metrics.qd_score
        assert int(row["total_steps"]) == metrics.total_steps
        counts = [int(row[f"new_elites_{operator.name.lower()}"]) for operator in Operator]
        assert tuple(counts) == metrics.new_elites
        assert row["committed"] == generation.committed


@pytest.mark.parametrize(
    "found",
    [
        lambda whole: b"",
        lambda whole: whole[:-10],
        lambda whole: whole + whole.splitlines(keepends=True)[-1],
        lambda whole: whole.replace(b",", b";"),
    ],
    ids=["empty", "row cut off", "row too many", "rewritten by a spreadsheet"],
)
def test_a_rebuilt_file_equals_the_one_that_grew(
    table: MetricsFile, generations: list[Generation], found
) -> None:
    whole = table.path.read_bytes()
    table.path.write_bytes(found(whole))
    table.rebuild(generations)
    assert table.path.read_bytes() == whole


def test_a_correct_file_is_not_touched(table: MetricsFile, generations: list[Generation]) -> None:
    before = table.path.stat()
    table.rebuild(generations)
    assert table.path.stat().st_ino == before.st_ino


def test_two_runs_differ_only_in_time_columns(
    table: MetricsFile, generations: list[Generation], tmp_path: Path
) -> None:
    other = MetricsFile(tmp_path / "other.csv")
    other.rebuild([replace(g, committed="2001-01-01T00:00:00.000+00:00") for g in generations])
    with table.path.open(newline="") as a, other.path.open(newline="") as b:
        for one, two in zip(csv.DictReader(a), csv.DictReader(b), strict=True):
            assert {name for name in COLUMNS if one[name] != two[name]} == set(TIME_COLUMNS)


def test_a_file_that_cannot_be_written_is_named(
    tmp_path: Path, generations: list[Generation]
) -> None:
    with pytest.raises(StorageError, match=r"absent/metrics\.csv"):
        MetricsFile(tmp_path / "absent" / "metrics.csv").rebuild(generations)


def test_every_column_is_documented() -> None:
    section = DOCUMENT.read_text().partition("### metrics.csv")[2].partition("\n#")[0]
    described = set()
    for row in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE):
        described |= set(re.findall(r"`([a-z_]+)`", row))
    assert described == set(COLUMNS)
