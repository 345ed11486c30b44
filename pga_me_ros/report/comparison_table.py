"""The comparison as a Markdown table of medians and p-values, with notes."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from pga_me_ros.report.comparison import METRICS, Comparison, TaskComparison, rank_sum_p

CORRECTED_NOTE = (
    "Corrected: all elites of the last generation re-evaluated and added to an empty archive by their means; falls: "
    "share of re-evaluations that ended in one."
)


def comparison_table(comparison: Comparison) -> str:
    """Return medians of the final metrics, with p-values against the reference, as Markdown."""
    metrics = comparison.metrics
    heads = [head for name in metrics.values() for head in (name, "p")]
    lines = [
        "| " + " | ".join(["task", "system", "runs", *heads]) + " |",
        "|" + "---|" * (3 + len(heads)),
    ]
    for task in comparison.tasks:
        lines += [_row(task, system, comparison.reference, metrics) for system in task.systems]
    lines += [
        "",
        "Medians of the runs; p: two-sided Wilcoxon rank-sum test of the runs against those of "
        f"{comparison.reference}, exact for few runs. Fitness difference: the best controller's single evaluation "
        "minus the mean of 10 more." + (f" {CORRECTED_NOTE}" if metrics != METRICS else ""),
        "",
    ]
    for task in comparison.tasks:
        lines.append(
            f"- {task.task}: after {task.evaluations:,.0f} evaluations; QD-score offset by {task.offset:,.1f}, the "
            "lowest fitness of all its runs"
        )
    if comparison.missing:
        lines += ["", "Runs that are missing:", ""]
        lines += [f"- {words}" for words in comparison.missing]
    return "\n".join(lines)


def _row(task: TaskComparison, system: str, reference: str, metrics: Iterable[str]) -> str:
    cells = [task.task, system, str(len(task.systems[system]))]
    for metric in metrics:
        values = task.final(system, metric)
        number = "{:.3f}" if metric == "fall_share" else "{:,.0f}"
        cells.append(number.format(np.median(values)) if len(values) else "-")
        p = math.nan
        if system != reference and reference in task.systems:
            p = rank_sum_p(values, task.final(reference, metric))
        cells.append(_p_value(p))
    return "| " + " | ".join(cells) + " |"


def _p_value(p: float) -> str:
    if math.isnan(p):
        return "-"
    return f"{p:.3f}" if p >= 0.001 else f"{p:.0e}"
