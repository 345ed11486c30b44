"""Draw the learning curves kept in docs/results: ``python scripts/result_curves.py [FOLDER]``.

A record is named after its task, its algorithm, settings that differ or a word for them, and its seed, with hyphens
between them; PGA-MAP-Elites with all defaults is not named. It needs the columns of a run's ``metrics.csv``
that are drawn.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter

from pga_me_ros.arrays import Float64Array
from pga_me_ros.report.paper import LABEL
from pga_me_ros.report.pictures import (
    CURVES,
    LINE_STYLES,
    PAPER_COLOR,
    draw_paper,
    legend,
    save,
)

DOCS = Path(__file__).resolve().parents[1] / "docs"
PLAIN = "pga_map_elites"

Record = Mapping[str, Float64Array]
"""Columns of a record by name, each (n,) float64."""


def read(file: Path) -> tuple[str, str, Record]:
    """Return the task of a record, what was run on it, and its columns."""
    task, *variant, _ = file.stem.split("-")
    algorithms, rest = variant[:1], variant[1:]
    rest = [re.sub(r"(?<=\D)(?=\d+$)", " ", part) for part in rest]  # "n_crit12000"
    with file.open() as lines:
        header, *rows = csv.reader(lines)
    columns = np.array(rows, dtype=np.float64).T
    return task, ", ".join([*algorithms, *rest]) or PLAIN, dict(zip(header, columns, strict=True))


def draw(files: Sequence[Path], folder: Path) -> list[Path]:
    """Draw a row per task; returns the files."""
    tasks: dict[str, list[tuple[str, Record]]] = {}
    for file in files:
        task, variant, record = read(file)
        tasks.setdefault(task, []).append((variant, record))
    variants = sorted({variant for group in tasks.values() for variant, _ in group})
    looks = dict(zip(variants, LINE_STYLES, strict=False))
    figure = Figure(figsize=(9.6, 2.5 * len(tasks)), layout="constrained")
    grid = figure.subplots(len(tasks), len(CURVES), squeeze=False, sharex="row")
    for row, (task, group) in zip(grid, tasks.items(), strict=True):
        last = max(record["evaluations"][-1] for _, record in group)
        for axes, (metric, label) in zip(row, CURVES, strict=True):
            for variant, record in group:
                color, line = looks[variant]
                axes.plot(record["evaluations"], record[metric], color=color, linestyle=line)
            draw_paper(axes, task, PLAIN, metric, last)
            axes.set_ylabel(label, fontsize=8)
            axes.tick_params(labelsize=8)
            axes.xaxis.set_major_formatter(EngFormatter(sep=""))
            axes.yaxis.set_major_formatter(EngFormatter(sep=""))
            axes.grid(alpha=0.3)
            axes.spines[["top", "right"]].set_visible(False)
        row[1].set_title(task, fontsize=10)
    for axes in grid[-1]:
        axes.set_xlabel("evaluations", fontsize=8)
    theirs = Line2D(
        [], [], color=PAPER_COLOR, linestyle="--", marker="o", label=f"{PLAIN}, {LABEL}"
    )
    figure.legend(loc="outside lower center", ncols=2, handles=[*legend(looks), theirs], fontsize=8)
    return save(figure, folder / "results-curves")


if __name__ == "__main__":
    for drawn in draw(
        sorted((DOCS / "results").glob("*.csv")),
        Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS / "pictures",
    ):
        print(drawn)
