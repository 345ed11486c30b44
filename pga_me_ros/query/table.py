"""Behaviors as a short table for people, or as JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from pga_me_ros.client import FoundBehavior, RepertoireInfo

HEADS = ("cell", "distance", "descriptor", "fitness", "spread", "of", "falls", "found with")


def table(behaviors: Sequence[FoundBehavior], info: RepertoireInfo) -> str:
    """Return behaviors as lines of text, with a heading that says what the numbers are.

    Args:
        behaviors: What was found.
        info: The repertoire that it was found in.
    """
    rows = [HEADS, *(_row(behavior) for behavior in behaviors)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADS))]
    lines = [
        "  ".join(word.rjust(width) for word, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join([f"{about(info)}", *lines])


def about(info: RepertoireInfo) -> str:
    """Return what the repertoire is, and what the columns of the table mean."""
    state = "still growing" if info.growing else "finished"
    lines = [
        f"{info.task}: {info.coverage} of {info.cells} cells after {info.evaluations:,} evaluations, {state}",
        f"descriptor: {', '.join(info.descriptor_names)}",
    ]
    if info.corrected_repeats:
        lines.append(
            f"all re-evaluated {info.corrected_repeats} times or more: {info.corrected_coverage} cells of the "
            f"corrected archive, {100.0 * info.corrected_fall_share:.1f} % falls"
        )
    lines.append(
        "fitness and descriptor: mean of so many re-evaluations (of), by the single evaluation where there are none (-)"
    )
    return "\n".join(lines)


def as_json(behaviors: Sequence[FoundBehavior], info: RepertoireInfo) -> str:
    """Return behaviors as JSON: an object with ``run_id``, ``task``, ``descriptor_names`` and ``behaviors``.

    What is not known is null.
    """
    content = {
        "run_id": info.run_id,
        "task": info.task,
        "descriptor_names": info.descriptor_names,
        "growing": info.growing,
        "behaviors": [_fields(behavior) for behavior in behaviors],
    }
    return json.dumps(content, indent=2, allow_nan=False)


def _row(b: FoundBehavior) -> tuple[str, ...]:
    numbers = " ".join(f"{x:.3f}" for x in b.promised_descriptor)
    means = ("-", "-", "-")
    if b.by_mean:
        spread = f"{b.fitness_spread:.1f}" if b.repeats > 1 else "-"
        means = (spread, str(b.repeats), f"{100.0 * b.fall_share:.0f} %")
    found = f"{b.fitness:.1f}{' (fell)' if b.terminated else ''}"
    return (str(b.cell), f"{b.distance:.3f}", numbers, f"{b.promised_fitness:.1f}", *means, found)


def _fields(b: FoundBehavior) -> dict[str, Any]:
    """Return what is known of a behavior, fit for JSON."""
    names = ("cell", "distance", "fitness", "evaluation", "generation", "made_by", "steps")
    fields: dict[str, Any] = {name: getattr(b, name) for name in names}
    fields |= {
        "descriptor": b.descriptor.tolist(),
        "terminated": b.terminated,
        "parents": list(b.parents),
        "by_mean": b.by_mean,
        "promised_fitness": b.promised_fitness,
        "promised_descriptor": b.promised_descriptor.tolist(),
        "repeats": b.repeats,
        "mean_fitness": _number(b.mean_fitness),
        "fitness_spread": _number(b.fitness_spread),
        "mean_descriptor": b.mean_descriptor.tolist() or None,
        "descriptor_spread": b.descriptor_spread.tolist() or None,
        "fall_share": _number(b.fall_share),
    }
    return fields


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
