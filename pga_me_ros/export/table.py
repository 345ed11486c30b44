"""Export as a table for spreadsheets and data frames: one line per elite, without parameters."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.storage.files import save_bytes
from pga_me_ros.export.source import Source

PLAIN = ("cell", "evaluation", "generation", "made_by", "parent1", "parent2", "steps", "terminated")


def write_csv(source: Source, path: Path) -> None:
    """Write the table; docs/export.md describes its columns. Numbers keep all their digits.

    Raises:
        StorageError: The file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = source.run.spec.descriptor_names
    header = [*PLAIN, "fitness", *names]
    again = bool(source.run.statistics.repeats.any())
    if again:
        header += ["repeats", "mean_fitness", "fitness_spread", "fall_share"]
        header += [f"{kind}:{name}" for kind in ("mean", "spread") for name in names]
    writer.writerow(header)
    for elite in source.elites():
        row = list(_row(elite))
        writer.writerow(row + list(_means(source, elite.cell)) if again else row)
    save_bytes(path, text.getvalue().encode())


def _row(elite: Elite) -> Iterator[object]:
    yield from (elite.cell, elite.evaluation, elite.generation, elite.operator.label)
    yield from ("" if parent < 0 else parent for parent in (elite.parent1, elite.parent2))
    yield from (elite.steps, int(elite.terminated), elite.fitness, *elite.descriptor.tolist())


def _means(source: Source, cell: int) -> Iterator[object]:
    known = source.run.statistics
    yield int(known.repeats[cell])
    numbers = [known.mean_fitness[cell], known.fitness_spread[cell], known.fall_share[cell]]
    numbers += [*known.mean_descriptor[cell], *known.descriptor_spread[cell]]
    yield from ("" if number != number else float(number) for number in numbers)  # NaN: none
