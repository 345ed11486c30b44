"""The pictures of a comparison: Figures 3 and 4 (Nilsson & Cully 2021) for the user's runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType

from pga_me_ros.core.archive.color_range import color_range
from pga_me_ros.core.archive.heatmap import draw_heatmap
from pga_me_ros.paths import file_name
from pga_me_ros.report.comparison import METRICS, Comparison, TaskComparison
from pga_me_ros.report.paper import LABEL
from pga_me_ros.report.pictures import (
    LINE_STYLES,
    PAPER_COLOR,
    draw_color_scale,
    draw_paper,
    label_axes,
    legend,
    save,
)

PIXELS = 480
LOWEST = 2.6
"""Least height of a picture with a color scale and its label, inches."""


def draw_curves_compared(
    comparison: Comparison, folder: Path, *, paper: bool = False
) -> list[Path]:
    """Draw four metrics on every task: median and quartiles of each system's runs; returns the files.

    Args:
        comparison: The comparison.
        folder: Folder of the files.
        paper: Whether to draw the authors' published medians of the systems' algorithms under them.
    """
    tasks = comparison.tasks
    size = (max(4.8, 3.2 * len(tasks)), 2.3 * len(METRICS))
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(METRICS), len(tasks), squeeze=False, sharex="col")
    systems = list(dict.fromkeys(system for task in tasks for system in task.systems))
    looks = {system: LINE_STYLES[i % len(LINE_STYLES)] for i, system in enumerate(systems)}
    for row, (metric, label) in zip(grid, METRICS.items(), strict=True):
        for axes, task in zip(row, tasks, strict=True):
            _draw_metric(axes, task, metric, looks)
            for system, runs in task.systems.items() if paper else ():
                color, last = looks[system][0], task.evaluations
                algorithm = runs[0].algorithm
                draw_paper(
                    axes, task.task, algorithm, metric, last, offset=task.offset, color=color
                )
        row[0].set_ylabel(label)
    for axes, task in zip(grid[0], tasks, strict=True):
        axes.set_title(task.task, fontsize=10)
    for axes in grid[-1]:
        axes.set_xlabel("evaluations")
    handles = legend(looks)
    if paper:
        handles.append(
            mpl.lines.Line2D(
                [], [], color=PAPER_COLOR, linestyle="--", linewidth=1, marker="o", label=LABEL
            )
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=min(3, len(handles)))
    return save(figure, folder / "comparison-curves")


def _draw_metric(
    axes: Axes, task: TaskComparison, metric: str, looks: Mapping[str, tuple[str, LineStyleType]]
) -> None:
    known = False
    for system in task.systems:
        evaluations, values = task.curve(system, metric)
        # Unknown values leave a gap; a metric without any known value gets no line.
        there = ~np.isnan(values).any(axis=0)
        if not there.any():
            continue
        known = True
        quartiles = np.full((3, len(evaluations)), np.nan)
        quartiles[:, there] = np.quantile(values[:, there], (0.25, 0.5, 0.75), axis=0)
        color, line = looks[system]
        axes.plot(evaluations, quartiles[1], color=color, linestyle=line, linewidth=1.4)
        if len(values) > 1:
            axes.fill_between(
                evaluations, quartiles[0], quartiles[2], color=color, alpha=0.2, linewidth=0
            )
    if not known:
        axes.text(0.5, 0.5, "not re-evaluated", transform=axes.transAxes, ha="center")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def draw_archives_compared(
    comparison: Comparison, folder: Path, *, single: bool = False
) -> list[Path]:
    """Draw an archive of every system side by side, in one picture per task with one color scale; returns the files.

    If the elites of all these runs were re-evaluated, it draws the corrected archives, unless `single` is set.
    """
    files = []
    for task in comparison.tasks:
        files += _draw_archives(task, folder, single=single)
    return files


def _draw_archives(task: TaskComparison, folder: Path, *, single: bool) -> list[Path]:
    """Draw the last archive of each system's run with the median QD-score; runs don't store earlier ones."""
    runs = {system: task.typical(system) for system in task.systems}
    corrected = not single and all(run.is_corrected for run in runs.values())
    archives = {system: run.load_archive(corrected=corrected) for system, run in runs.items()}
    fitness = np.concatenate([archive.fitness[archive.filled] for archive in archives.values()])
    low, high = color_range(fitness)
    columns = min(3, len(runs))
    rows = -(-len(runs) // columns)
    one_dimension = next(iter(archives.values())).dimensions == 1
    height = max(1.7 * rows, LOWEST) if one_dimension else 3.1 * rows
    figure = Figure(figsize=(3.1 * columns + 0.9, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(runs) :]:
        axes.set_visible(False)
    for axes, (system, archive) in zip(grid.flat, archives.items(), strict=False):
        bounds = [*zip(archive.low, archive.high, strict=True), (0.0, 1.0)]
        extent = (*bounds[0], *bounds[1])
        image = draw_heatmap(archive, PIXELS, low, high)
        axes.imshow(image, extent=extent, aspect="auto", interpolation="nearest")
        label_axes(axes, runs[system].spec.descriptor_names)
        # All have the same axes, so they are labeled once.
        figure.supxlabel(axes.get_xlabel(), fontsize=10)
        figure.supylabel(axes.get_ylabel(), fontsize=10)
        axes.set(xlabel="", ylabel="")
        run = runs[system]
        last = f"after {run.evaluations[-1]:,.0f} evaluations"
        axes.set_title(f"{system}, seed {run.seed}\n{last}", fontsize=9)
    draw_color_scale(figure, grid, "fitness (sum of rewards)", fitness)
    what = ", corrected by the means of re-evaluations" if corrected else ""
    title = (
        f"{task.task}: of each system the run with the median QD-score\n"
        f"after {task.evaluations:,.0f} evaluations; its last archive{what}"
    )
    figure.suptitle(title, fontsize=10)
    return save(figure, folder / f"comparison-{file_name(task.task)}-archives")
