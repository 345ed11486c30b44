"""An archive as the repertoire's services tell of it: its cells made anew, its elites from their answers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pga_me_ros.client import ListedBehavior, RepertoireInfo
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.registry import task_spec
from pga_me_ros.tasks.spec import TaskSpec


def spec_of(info: RepertoireInfo, settings: Settings) -> tuple[TaskSpec, bool]:
    """Return the spec of a served run's task, and whether the task is known on this machine.

    Of an unknown task it has what the cells of the archive depend on.

    Raises:
        TaskError: The task is unknown, and the archive is a grid, whose bins only the task tells.
    """
    try:
        return task_spec(settings.task), True
    except TaskError:
        if info.archive == "grid":
            raise
    low, high = info.descriptor_low.tolist(), info.descriptor_high.tolist()
    spec = TaskSpec(
        name=info.task,
        observation_names=("unknown",),
        observation_units=("",),
        action_names=("unknown",),
        action_units=("",),
        action_low=(-1.0,),
        action_high=(1.0,),
        descriptor_names=tuple(info.descriptor_names),
        descriptor_low=tuple(low),
        descriptor_high=tuple(high),
        max_steps=1,
        control_period=1.0,
        archive_cells=info.cells,
        archive_bins=(1,) * len(low),
    )
    return spec, False


def served_archive(
    spec: TaskSpec, settings: Settings, behaviors: Sequence[ListedBehavior]
) -> tuple[Archive, Statistics]:
    """Return an archive with all but the controllers, and what is known of its elites.

    Args:
        spec: Task of the run.
        settings: Its settings.
        behaviors: Its behaviors.
    """
    archive = make_archive(spec, settings)
    known = Statistics.none(archive.cells, archive.dimensions)
    labels = {operator.label: int(operator) for operator in Operator}
    for behavior in behaviors:
        cell = behavior.cell
        archive.filled[cell] = True
        archive.fitness[cell] = behavior.fitness
        archive.descriptors[cell] = behavior.descriptor
        archive.evaluations[cell] = behavior.evaluation
        archive.generations[cell] = behavior.generation
        archive.operators[cell] = labels.get(behavior.made_by, 0)
        archive.parents[cell, : len(behavior.parents)] = behavior.parents
        archive.steps[cell] = behavior.steps
        archive.terminated[cell] = behavior.terminated
        known.repeats[cell] = behavior.repeats
        known.mean_fitness[cell] = behavior.mean_fitness
        known.fitness_spread[cell] = behavior.fitness_spread
        known.fall_share[cell] = behavior.fall_share
        for row, values in (
            (known.mean_descriptor, behavior.mean_descriptor),
            (known.descriptor_spread, behavior.descriptor_spread),
        ):
            row[cell] = values if len(values) else np.nan
    return archive, known
