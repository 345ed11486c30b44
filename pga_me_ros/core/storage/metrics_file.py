"""metrics.csv: one row per committed generation, for plotting tools and spreadsheets."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from pga_me_ros.core.archive.corrected import CorrectedMetrics
from pga_me_ros.core.archive.metrics import PER_OPERATOR, Metrics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.database import explained
from pga_me_ros.core.storage.files import replace_file
from pga_me_ros.core.storage.reevaluations import Measured
from pga_me_ros.core.storage.rows import Generation

METRICS_FILE = "metrics.csv"

_NUMBERS = (
    "generation",
    "evaluations",
    "coverage",
    "coverage_share",
    "qd_score",
    "max_fitness",
    "mean_fitness",
    "steps",
    "total_steps",
    "min_fitness",
    "best_evaluation",
)

_CORRECTED = tuple(f.name for f in fields(CorrectedMetrics))

TIME_COLUMNS = ("committed",)
"""Columns that differ between two runs with the same settings; all others are equal, bit for bit."""

COLUMNS = (
    *_NUMBERS,
    *(f"{name}_{operator.label}" for name in PER_OPERATOR for operator in Operator),
    *(f"corrected_{name}" for name in _CORRECTED),
    *TIME_COLUMNS,
)
"""Columns of the table; those that begin with ``corrected_`` are empty where the archive was not re-evaluated."""


class MetricsFile:
    """The table of a run, a copy of what its repertoire file holds.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def rebuild(self, generations: Sequence[Generation], measured: Sequence[Measured] = ()) -> None:
        """Make the file hold exactly these generations; a crash leaves the old or the new one, whole.

        Args:
            generations: All generations.
            measured: What the archives of some of them are worth by re-evaluations.

        Raises:
            StorageError: The file cannot be written.
        """
        known = {m.generation: m.corrected for m in measured}
        content = _lines([COLUMNS, *(_row(generation, known) for generation in generations)])
        with explained(self.path):
            if self.path.exists() and self.path.read_bytes() == content:
                return
            replace_file(self.path, content)

    def append(self, generation: Generation) -> None:
        """Add the row of a generation that was just committed.

        Raises:
            StorageError: The file cannot be written.
        """
        with explained(self.path), self.path.open("ab") as file:
            file.write(_lines([_row(generation, {})]))


def _row(generation: Generation, known: Mapping[int, CorrectedMetrics]) -> list[object]:
    metrics: Metrics = generation.metrics
    numbers = [getattr(metrics, name) for name in _NUMBERS]
    counts = [count for name in PER_OPERATOR for count in getattr(metrics, name)]
    corrected = known.get(metrics.generation)
    measures = [getattr(corrected, name) if corrected else "" for name in _CORRECTED]
    return [*numbers, *counts, *measures, generation.committed]


def _lines(rows: Sequence[Sequence[object]]) -> bytes:
    """Return rows as CSV, with floats in full precision."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
