"""The picture of an adaptation: what was expected before each trial, what it achieved, and what else there is."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pga_me_ros.adapt_demo.robot import POSES, Achieved
from pga_me_ros.adapt_demo.story import Found, Map, Step
from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.storage.files import save_bytes

FEW = 6
"""Number of maps up to which 3 stand in a row, beyond which 4."""

WIDTH, HEIGHT = 2.7, 2.3
"""Size of a map, inches."""

TOP = 0.6
"""Height of title and legend, inches."""

BARS = 0.32
"""Height of a bar with the space around it, inches."""

PROMISED, ACHIEVED, OURS, OTHERS = "#b0b0b0", "#d55e00", "#009e73", "#808080"
"""Colors: promises, results of trials, adaptation, what it is compared with."""

COLORS = "viridis_r"
"""Colors of what is expected, from certain to uncertain."""

mpl.use("Agg")
mpl.rcParams["svg.hashsalt"] = "pga_me_ros"  # the same demonstration gives the same file


def draw(
    steps: Sequence[Step],
    after: Map,
    found: Sequence[Found],
    sound: Achieved,
    title: str,
    names: Sequence[str],
    out: Path,
) -> None:
    """Draw an adaptation: a map before each trial and one after the last, and what the robot achieves then.

    Args:
        steps: The trials.
        after: What is expected after the last one.
        found: Gaits and what they achieve; the last one is what adaptation found.
        sound: What the gait with the best promise achieves on the sound robot.
        title: What it is about.
        names: Names of the descriptor's dimensions.
        out: File to write.

    Raises:
        StorageError: The file cannot be written.
    """
    maps = [*(step.before for step in steps), after]
    columns = 3 if len(maps) <= FEW else 4
    rows = -(-len(maps) // columns)
    below = BARS * (len(found) + 1) + 0.6
    heights = (TOP, rows * HEIGHT, below)
    figure = Figure(figsize=(columns * WIDTH + 0.6, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(
        3, 1, height_ratios=heights
    )  # an array, whatever its annotation says
    top, middle, bottom = parts
    top.suptitle(title, fontsize=11, y=0.9)
    top.legend(handles=_legend(), loc="lower center", ncols=4, fontsize=9, frameon=False)
    axes = middle.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    scale = ScalarMappable(Normalize(0.0, max(float(m.uncertainty.max()) for m in maps)), COLORS)
    for number, panel in enumerate(axes.flat):
        if number >= len(maps):
            panel.set_visible(False)
            continue
        _draw_map(panel, steps, maps[number], number, scale)
        if number >= len(maps) - columns:
            panel.tick_params(labelbottom=True)
            panel.set_xlabel(_label(names))
    for panel in axes[:, 0]:
        panel.set_ylabel("fitness")
    middle.colorbar(scale, ax=axes, label="uncertainty of the expectation", fraction=0.03)
    _draw_bars(bottom.add_subplot(), found, sound)
    content, kind = io.BytesIO(), out.suffix.lower().removeprefix(".")
    figure.savefig(content, format=kind, dpi=120, metadata={"Date": None} if kind == "svg" else {})
    save_bytes(out, content.getvalue())


def _draw_map(
    axes: Axes, steps: Sequence[Step], present: Map, number: int, scale: ScalarMappable
) -> None:
    """Draw what is expected after so many trials, what these achieved, and which one is next."""
    x, order = _places(present)
    axes.plot(x, present.promised[order], ".", color=PROMISED, markersize=3, zorder=1)
    colors = scale.to_rgba(present.uncertainty[order])
    axes.scatter(x, present.expected[order], s=10, c=colors, zorder=2)
    place = np.empty(len(order))
    place[order] = x
    for step in steps[:number]:
        axes.plot(place[step.row], step.episode.fitness, "x", color=ACHIEVED, zorder=3)
    if number < len(steps):
        step = steps[number]
        at, achieved = place[step.row], step.episode.fitness
        axes.annotate(
            "",
            (at, achieved),
            (at, step.trial.expected),
            arrowprops={"arrowstyle": "->", "color": ACHIEVED, "shrinkA": 0, "shrinkB": 0},
            zorder=3,
        )
        axes.plot(at, achieved, "x", color=ACHIEVED, zorder=3)
        axes.set_title(f"trial {number + 1} achieves {achieved:.0f}", fontsize=10)
    else:
        best = max(steps, key=lambda step: step.episode.fitness)
        axes.plot(
            place[best.row],
            best.episode.fitness,
            "o",
            mfc="none",
            color=OURS,
            markersize=11,
            zorder=4,
        )
        axes.set_title("what is expected afterwards", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def _places(present: Map) -> tuple[Float64Array, np.ndarray]:
    """Return where each behavior stands on the x axis, ascending, and the behaviors in this order.

    One descriptor is that axis itself; of several, behaviors are drawn side by side, those with the best promise first.
    """
    if present.descriptors.shape[1] == 1:
        order = np.argsort(present.descriptors[:, 0], kind="stable")
        return present.descriptors[order, 0], order
    order = np.argsort(-present.promised, kind="stable")
    return np.arange(1.0, len(order) + 1.0), order


def _label(names: Sequence[str]) -> str:
    if len(names) > 1:
        return "gait, best promise first"
    return names[0].replace("_", " ").replace("/", ": ")


def _legend() -> list[Line2D]:
    def mark(marker: str, color: str, label: str) -> Line2D:
        return Line2D([], [], linestyle="", marker=marker, color=color, label=label)

    return [
        mark(".", PROMISED, "promised by the repertoire"),
        mark("o", "#35b779", "expected now"),
        mark("x", ACHIEVED, "achieved in a trial"),
        Line2D([], [], linestyle="", marker="o", mfc="none", color=OURS, label="best trial"),
    ]


def _draw_bars(axes: Axes, found: Sequence[Found], sound: Achieved) -> None:
    """Draw what each gait achieves, with the sound robot on top."""
    names = ["the promised gait, before", *(way.name for way in found)]
    fitness = [sound.fitness, *(way.average.fitness for way in found)]
    colors = [PROMISED, *[OTHERS] * (len(found) - 1), OURS]
    bars = axes.barh(names, fitness, color=colors)
    axes.bar_label(bars, fmt="{:.0f}", padding=3, fontsize=9)
    axes.invert_yaxis()
    axes.set_xlabel(f"fitness, mean of {POSES} starts")
    axes.spines[["top", "right"]].set_visible(False)
