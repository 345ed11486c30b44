"""The pictures: archives as in Figure 4, learning curves as in Figure 3 (Nilsson & Cully 2021)."""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import LineStyleType
from numpy.typing import NDArray

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.color_range import color_range
from pga_me_ros.core.archive.corrected import corrected_archive, steady_archive
from pga_me_ros.core.archive.heatmap import ANCHORS, Image, draw_heatmap
from pga_me_ros.core.storage.files import save_bytes
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.paths import file_name
from pga_me_ros.report.compared_run import common_grid, values_at
from pga_me_ros.report.paper import LABEL, SYSTEMS, curves_beside, paper_curve, published_at

CURVES = (
    ("qd_score", "QD-score (sum of fitness)"),
    ("coverage", "coverage (filled cells)"),
    ("max_fitness", "best fitness"),
)
FORMATS = ("png", "svg")
LINE_STYLES: tuple[tuple[str, LineStyleType], ...] = (
    ("#0072b2", "-"),
    ("#e69f00", "--"),
    ("#009e73", "-."),
    ("#cc79a7", ":"),
    ("#56b4e9", (0, (5, 1))),
    ("#d55e00", (0, (3, 1, 1, 1))),
    ("#000000", (0, (1, 1))),
)
"""Color and line style of each system in turn; the colors are colorblind-safe (Okabe and Ito)."""

PAPER_COLOR = "#707070"
HALF = 0.5
HATCH = 9
"""Spacing of the hatching lines along a side of the picture, pixels."""

PIXELS = 960
MARGIN = 0.06
"""White space around a picture, inches."""

mpl.use("Agg")
mpl.rcParams["svg.hashsalt"] = "pga_me_ros"  # the same run gives the same file


def draw_archive(run: StoredRun, folder: Path, *, single: bool = False) -> list[Path]:
    """Draw the archive of a run as a heatmap of fitness.

    If all elites were re-evaluated, it draws the corrected archive, with the means of these evaluations; the title says
    so.

    Args:
        run: The run.
        folder: Folder of the files.
        single: Whether to draw each elite by its original, single evaluation.

    Returns:
        The files.
    """
    figure = Figure(
        figsize=(6.4, 3.2 if run.archive.dimensions == 1 else 5.4), layout="constrained"
    )
    axes = figure.add_subplot()
    low, high = run.archive.low, run.archive.high
    extent = (low[0], high[0], *((low[1], high[1]) if len(low) > 1 else (0.0, 1.0)))
    again = None if single else run.corrected
    archive = corrected_archive(run.archive, run.statistics) if again else run.archive
    image = draw_heatmap(archive, PIXELS)
    if again:
        image = hatched(image, steady_archive(run.archive, run.statistics, HALF), archive)
    axes.imshow(image, extent=extent, aspect="auto", interpolation="nearest")
    label_axes(axes, run.spec.descriptor_names)
    title = (
        f"{run.spec.name}: {archive.coverage} of {archive.cells} cells after "
        f"{run.metrics[-1].evaluations:,} evaluations"
    )
    if again:
        title += f"\ncorrected by the means of {again.repeats} re-evaluations; hatched: falls in more than half of them"
    axes.set_title(title, fontsize=10)
    label = "mean fitness (sum of rewards)" if again else "fitness (sum of rewards)"
    draw_color_scale(figure, axes, label, archive.fitness[archive.filled])
    return save(figure, folder / f"{run.name}-archive")


def draw_color_scale(
    figure: Figure, axes: Axes | NDArray[Any], label: str, fitness: Float64Array
) -> None:
    """Draw the scale of a heatmap's colors; an arrow at an end, and the label, tell which fitness is beyond it.

    Args:
        figure: The figure.
        axes: The axes of the heatmaps.
        label: What the colors show.
        fitness: (n,) fitness of all elites shown.
    """
    low, high = color_range(fitness)
    least, most = fitness.min(initial=low), fitness.max(initial=high)
    beyond = [f"down to {least:,.0f}"] * bool(least < low) + [f"up to {most:,.0f}"] * bool(
        most > high
    )
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}
    colors = LinearSegmentedColormap.from_list("fitness", np.array(ANCHORS) / 255.0)
    figure.colorbar(
        mpl.cm.ScalarMappable(Normalize(low, high), colors),
        ax=axes,
        label=f"{label}; outliers: {', '.join(beyond)}" if beyond else label,
        extend=extend.get((bool(least < low), bool(most > high)), "neither"),
    )


def hatched(image: Image, steady: Archive, whole: Archive) -> Image:
    """Return a heatmap with white lines across elites that are not steady.

    Args:
        image: Heatmap of the whole archive.
        steady: The archive with only its steady elites.
        whole: The whole archive.
    """
    fitness = whole.fitness[whole.filled]
    if not len(fitness):
        return image
    # A pixel shows the fittest of its cells, so a pixel that changes without the other elites shows one of them.
    alone = draw_heatmap(steady, PIXELS, *color_range(fitness))
    rows, columns = np.indices(image.shape[:2])
    lines = (rows + columns) % HATCH < HATCH // 3
    marked = (image != alone).any(axis=2) & lines
    return np.where(marked[..., None], np.uint8(255), image)


def draw_curves(runs: Sequence[StoredRun], folder: Path, *, paper: bool = False) -> list[Path]:
    """Draw learning curves of runs on one task: each algorithm's median, and quartiles if it has several runs.

    Args:
        runs: The runs; each algorithm's curve ends with its run of the fewest evaluations.
        folder: Folder of the files.
        paper: Whether to draw the authors' published medians under them: those of the runs' algorithms, or of
            PGA-MAP-Elites if they published none of these.

    Returns:
        The files.
    """
    figure = Figure(figsize=(9.6, 2.9), layout="constrained")
    groups: dict[str, list[StoredRun]] = defaultdict(list)
    for run in runs:
        groups[run.settings.algorithm].append(run)
    looks = {name: LINE_STYLES[i % len(LINE_STYLES)] for i, name in enumerate(groups)}
    last = max(run.metrics[-1].evaluations for run in runs)
    task = runs[0].spec.name
    published = [
        name for name in curves_beside(groups) if paper and published_at(task, name, last)[1]
    ]
    for axes, (name, label) in zip(figure.subplots(1, len(CURVES)), CURVES, strict=True):
        for algorithm, group in groups.items():
            _draw_curve(axes, group, name, *looks[algorithm])
        for algorithm in published:
            color = looks[algorithm][0] if len(groups) > 1 else PAPER_COLOR
            draw_paper(axes, task, algorithm, name, last, color=color)
        axes.set_xlabel("evaluations")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    if len(groups) > 1:
        figure.legend(loc="outside lower center", ncols=len(groups), handles=legend(looks))
    many = f", median and quartiles of {len(runs)} runs" if len(runs) > len(groups) else ""
    theirs = ", ".join(SYSTEMS[name] for name in published)
    figure.suptitle(f"{task}{many}{f'; dots: {LABEL}, {theirs}' if published else ''}", fontsize=10)
    return save(figure, folder / f"{file_name(task)}-curves")


def _draw_curve(
    axes: Axes, runs: Sequence[StoredRun], metric: str, color: str, line: LineStyleType
) -> None:
    ends = [run.curve("evaluations") for run in runs]
    evaluations = common_grid(ends, min(end[-1] for end in ends))
    curves = np.stack(
        [values_at(e, run.curve(metric), evaluations) for e, run in zip(ends, runs, strict=True)]
    )
    first, median, third = np.quantile(curves, (0.25, 0.5, 0.75), axis=0)
    axes.plot(evaluations, median, color=color, linestyle=line)
    if len(runs) > 1:
        axes.fill_between(evaluations, first, third, color=color, alpha=0.25, linewidth=0)


def legend(looks: Mapping[str, tuple[str, LineStyleType]]) -> list[Line2D]:
    """Return legend entries for lines by name."""
    return [
        Line2D([], [], color=color, linestyle=line, label=name)
        for name, (color, line) in looks.items()
    ]


def draw_paper(
    axes: Axes,
    task: str,
    algorithm: str,
    metric: str,
    last: float,
    *,
    offset: float = 0.0,
    color: str = PAPER_COLOR,
) -> None:
    """Draw the authors' medians up to the end of the user's curves, with the error of reading them off figures.

    Args:
        axes: Axes to draw on.
        task: Name of the task.
        algorithm: Value of the setting `algorithm`.
        metric: Metric of the curve.
        last: Number of evaluations at the end of the user's curves.
        offset: Fitness that QD-scores are measured from.
        color: Color of the line.
    """
    curve = paper_curve(task, algorithm, metric, offset)
    if curve is None:
        return
    curve = curve.until(last)
    axes.plot(curve.evaluations, curve.median, color=color, linestyle="--", linewidth=1, zorder=1)
    read = ~np.isnan(curve.plus_minus)
    axes.errorbar(
        curve.evaluations[read],
        curve.median[read],
        curve.plus_minus[read],
        color=color,
        fmt="o",
        markersize=2.5,
        linewidth=1,
        zorder=1,
    )


def label_axes(axes: Axes, names: Sequence[str]) -> None:
    """Label the axes with descriptor names; for nested maps, the outer descriptor comes first."""
    axes.set_xlabel(_axis_label(names[0::2]))
    if len(names) > 1:
        axes.set_ylabel(_axis_label(names[1::2]))
    else:
        axes.set_yticks([])


def _axis_label(names: Sequence[str]) -> str:
    """Return descriptor names such as ``left_foot/contact_share`` as words, a common quantity only once."""
    parts, quantities = zip(
        *(name.replace("_", " ").partition("/")[::2] for name in names), strict=True
    )
    text = ", then ".join(parts)
    return f"{quantities[0]} of {text}" if quantities[0] and len(set(quantities)) == 1 else text


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure in every format; returns the files."""
    files = [stem.with_name(f"{stem.name}.{kind}") for kind in FORMATS]
    for file in files:
        metadata = {"Date": None} if file.suffix == ".svg" else {}
        # Tight bounding box: long names, and labels of low pictures, would be cut off otherwise.
        content = io.BytesIO()
        figure.savefig(
            content,
            format=file.suffix.removeprefix("."),
            dpi=120,
            metadata=metadata,
            bbox_inches="tight",
            pad_inches=MARGIN,
        )
        save_bytes(file, content.getvalue())
    return files
