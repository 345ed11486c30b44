"""The pictures: archives as in Figure 4, learning curves as in Figure 3 (Nilsson & Cully 2021)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from pga_me_ros.core.archive.heatmap import ANCHORS, draw_heatmap
from pga_me_ros.core.storage.stored_run import StoredRun

CURVES = (
    ("qd_score", "QD-score (sum of fitness)"),
    ("coverage", "coverage (filled cells)"),
    ("max_fitness", "best fitness"),
)
FORMATS = ("png", "svg")
COLOR = "#28708c"
PIXELS = 960

mpl.use("Agg")
mpl.rcParams["svg.hashsalt"] = "pga_me_ros"  # the same run gives the same file


def draw_archive(run: StoredRun, folder: Path) -> list[Path]:
    """Draw the archive of a run as a heatmap of fitness.

    Args:
        run: The run.
        folder: Where to.

    Returns:
        The files.
    """
    figure = Figure(
        figsize=(6.4, 3.2 if run.archive.dimensions == 1 else 5.4), layout="constrained"
    )
    axes = figure.add_subplot()
    low, high = run.archive.low, run.archive.high
    extent = (low[0], high[0], *((low[1], high[1]) if len(low) > 1 else (0.0, 1.0)))
    axes.imshow(
        draw_heatmap(run.archive, PIXELS), extent=extent, aspect="auto", interpolation="nearest"
    )
    label_axes(axes, run.spec.descriptor_names)
    last = run.metrics[-1]
    axes.set_title(
        f"{run.spec.name}: {last.coverage} of {run.archive.cells} cells after "
        f"{last.evaluations:,} evaluations",
        fontsize=10,
    )
    fitness = run.archive.fitness[run.archive.filled]
    colors = LinearSegmentedColormap.from_list("fitness", np.array(ANCHORS) / 255.0)
    least, most = (fitness.min(), fitness.max()) if len(fitness) else (0.0, 1.0)
    scale = mpl.cm.ScalarMappable(Normalize(least, most), colors)
    figure.colorbar(scale, ax=axes, label="fitness (sum of rewards)")
    return save(figure, folder / f"{run.name}-archive")


def draw_curves(runs: Sequence[StoredRun], folder: Path) -> list[Path]:
    """Draw learning curves of runs of one task: the median, and the quartiles if there are several.

    Args:
        runs: The runs; what counts is as far as the shortest of them goes.
        folder: Where to.

    Returns:
        The files.
    """
    figure = Figure(figsize=(9.6, 2.9), layout="constrained")
    length = min(len(run.metrics) for run in runs)
    evaluations = runs[0].curve("evaluations")[:length]
    for axes, (name, label) in zip(figure.subplots(1, len(CURVES)), CURVES, strict=True):
        curves = np.stack([run.curve(name)[:length] for run in runs])
        first, median, third = np.quantile(curves, (0.25, 0.5, 0.75), axis=0)
        axes.plot(evaluations, median, color=COLOR)
        if len(runs) > 1:
            axes.fill_between(evaluations, first, third, color=COLOR, alpha=0.25, linewidth=0)
        axes.set_xlabel("evaluations")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    many = f", median and quartiles of {len(runs)} runs" if len(runs) > 1 else ""
    figure.suptitle(f"{runs[0].spec.name}{many}", fontsize=10)
    return save(figure, folder / f"{runs[0].spec.name}-curves")


def label_axes(axes: Axes, names: Sequence[str]) -> None:
    """Name the axes by the descriptors; of a map within a map, the outer one comes first."""
    axes.set_xlabel(_axis_label(names[0::2]))
    if len(names) > 1:
        axes.set_ylabel(_axis_label(names[1::2]))
    else:
        axes.set_yticks([])


def _axis_label(names: Sequence[str]) -> str:
    """Return descriptor names such as ``left_foot/contact_share`` as words, what they share said once."""
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
        figure.savefig(file, dpi=120, metadata=metadata)
    return files
