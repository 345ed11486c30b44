"""Lineage: which operator made each elite of an archive, where it is, and when it was made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, MaxNLocator

from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.report.pictures import label_axes, save

COLORS = (
    *("#999999", "#e69f00", "#0072b2", "#000000", "#cc79a7", "#56b4e9", "#d55e00", "#009e73"),
    *("#f0e442", "#882255"),
)
"""Colorblind-safe colors (Okabe and Ito), by operator; further operators reuse them."""

MARKS = ("D", "^", "o", "*", "s", "v", "<", ">", "P")
"""Markers by operator, so that operators differ by more than color."""

BARS = 40
"""Approximate number of bars; each covers one or more whole generations."""


def look(operator: int) -> tuple[str, str]:
    """Return the color and the marker of an operator; the pair is unique among 81 operators."""
    turn, place = divmod(operator, len(COLORS))
    return COLORS[place], MARKS[(place + turn) % len(MARKS)]


def draw_lineage(run: StoredRun, folder: Path) -> list[Path]:
    """Draw where each operator's elites are in descriptor space, and when they were made.

    Args:
        run: The run.
        folder: Folder of the files.

    Returns:
        The files.
    """
    made: dict[Operator, list[Elite]] = {operator: [] for operator in Operator}
    for elite in run.archive.elites():
        made[elite.operator].append(elite)
    made = {operator: elites for operator, elites in made.items() if elites}
    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    where, when = figure.subplots(1, 2)
    _draw_where(where, run, made)
    _draw_when(when, run, made)
    shares = ", ".join(f"{len(elites)} {OPERATORS[op].title}" for op, elites in made.items())
    figure.suptitle(f"{run.spec.name}: elites by what made them: {shares}", fontsize=10)
    figure.legend(*where.get_legend_handles_labels(), loc="outside lower center", ncols=len(made))
    return save(figure, folder / f"{run.name}-lineage")


def _draw_where(axes: Axes, run: StoredRun, made: dict[Operator, list[Elite]]) -> None:
    """Draw a marker per elite: its first two descriptor entries, or its only one against its fitness."""
    for operator, elites in made.items():
        color, mark = look(operator)
        points = np.array([elite.descriptor for elite in elites])
        y = points[:, 1] if points.shape[1] > 1 else np.array([e.fitness for e in elites])
        size = 60 if operator is Operator.GREEDY else 12
        axes.scatter(
            points[:, 0],
            y,
            s=size,
            color=color,
            marker=mark,
            label=OPERATORS[operator].title,
            linewidth=0,
        )
    label_axes(axes, run.spec.descriptor_names[:2])
    if run.archive.dimensions == 1:
        axes.set_ylabel("fitness (sum of rewards)")
        axes.yaxis.set_major_locator(AutoLocator())


def _draw_when(axes: Axes, run: StoredRun, made: dict[Operator, list[Elite]]) -> None:
    # Bars cover whole generations: otherwise greedy controllers, first in each batch, would make a comb pattern.
    ends = [0, *(metrics.evaluations for metrics in run.metrics)]
    edges = ends[:: max(1, len(ends) // BARS)]
    edges += [ends[-1]] if edges[-1] != ends[-1] else []
    axes.hist(
        [[elite.evaluation for elite in elites] for elites in made.values()],
        bins=edges,
        stacked=True,
        color=[look(operator)[0] for operator in made],
    )
    axes.set_xlabel("made in evaluation")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("elites in the archive")
    axes.spines[["top", "right"]].set_visible(False)
