"""A stored run as plain JSON: everything that the page shows besides motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.metrics import PER_OPERATOR
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.tasks.spec import TaskSpec

CURVES = ("generation", "evaluations", "coverage", "qd_score", "max_fitness", "mean_fitness")
"""Metrics of each generation that the page draws as curves."""


def describe(run: StoredRun, name: str) -> dict[str, Any]:
    """Return what the page shows of a run, fit for JSON; numbers that are not known are None.

    Args:
        run: The run.
        name: What the user calls it, for commands that the page offers to copy.
    """
    corrected = run.corrected
    return {
        "run": {
            "name": name,
            "task": run.settings.task,
            "algorithm": run.settings.algorithm,
            "seed": run.settings.seed,
            "run_id": run.info.run_id,
            "note": run.archive.note,
        },
        "spec": describe_spec(run.spec),
        "archive": describe_cells(run.archive),
        "elites": describe_elites(run.archive, run.statistics),
        "operators": {operator.label: OPERATORS[operator].title for operator in Operator},
        "curves": {key: numbers(run.curve(key)) for key in CURVES},
        "contributions": contributions(
            lambda name, operator: sum(getattr(g.metrics, name)[operator] for g in run.generations)
        ),
        "corrected": plain(asdict(corrected)) if corrected else None,
        "measured": [
            plain({"generation": m.generation, **asdict(m.corrected)})
            for m in run.reevaluations.measured
        ],
    }


def describe_spec(spec: TaskSpec) -> dict[str, Any]:
    """Return what the page needs to know of a task."""
    return {
        "name": spec.name,
        "descriptor_names": list(spec.descriptor_names),
        "descriptor_low": list(spec.descriptor_low),
        "descriptor_high": list(spec.descriptor_high),
        "control_period": spec.control_period,
        "max_steps": spec.max_steps,
    }


def describe_cells(archive: Archive) -> dict[str, Any]:
    """Return where the cells of an archive are.

    The centers, and the corners of the whole box, are in the coordinates that decide on the cell, so that the page can
    draw the borders between cells as the archive has them.
    """
    box = archive.coordinates(np.stack([archive.low, archive.high]))
    return {
        "kind": archive.kind,
        "bins": list(archive.bins),
        "cells": archive.cells,
        "box": box.tolist(),
        "centers": np.round(archive.coordinates(archive.centroids), 7).tolist(),
    }


def describe_elites(archive: Archive, known: Statistics) -> dict[str, Any]:
    """Return what is known of the elites, as lists of the same length."""
    cells = archive.filled_cells()
    means = known.mean_descriptor[cells]
    judged = np.isfinite(means).all(axis=1)
    achieved = np.full(len(cells), -1, np.int64)
    if judged.any():
        achieved[judged] = archive.cell_of(means[judged])
    return {
        "cell": cells.tolist(),
        "fitness": numbers(archive.fitness[cells]),
        "descriptor": numbers(archive.descriptors[cells]),
        "evaluation": archive.evaluations[cells].tolist(),
        "generation": archive.generations[cells].tolist(),
        "made_by": [Operator(code).label for code in archive.operators[cells].tolist()],
        "parents": [[p for p in row if p >= 0] for row in archive.parents[cells].tolist()],
        "steps": archive.steps[cells].tolist(),
        "terminated": archive.terminated[cells].tolist(),
        "repeats": known.repeats[cells].tolist(),
        "mean_fitness": numbers(known.mean_fitness[cells]),
        "fitness_spread": numbers(known.fitness_spread[cells]),
        "mean_descriptor": numbers(means),
        "descriptor_spread": numbers(known.descriptor_spread[cells]),
        "fall_share": numbers(known.fall_share[cells]),
        "mean_cell": [cell if cell >= 0 else None for cell in achieved.tolist()],
    }


def contributions(total: Callable[[str, Operator], int]) -> list[dict[str, Any]]:
    """Return, for each operator that made anything, how much it made and how much of that entered the archive.

    Args:
        total: Returns one of `PER_OPERATOR` of an operator, summed over all generations.
    """
    rows = []
    for operator in Operator:
        sums = {name: total(name, operator) for name in PER_OPERATOR}
        if sums["offspring"]:
            rows.append({"operator": operator.label, **sums})
    return rows


def numbers(values: NDArray[np.float64]) -> list[Any]:
    """Return an array as nested lists, NaN and infinities as None."""
    listed: list[Any] = plain(values.tolist())
    return listed


def plain(value: Any) -> Any:
    """Return lists, dicts and numbers with every number that JSON does not have as None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return value
