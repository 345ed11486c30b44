"""What an export takes from a run: its description, its archive, and the chosen elites."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pga_me_ros.core.archive.choosing import Demands, Judging
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.storage.known_behavior import KnownBehavior
from pga_me_ros.core.storage.npz import LAYOUT
from pga_me_ros.core.storage.stored_run import StoredRun

OF_ROBOT = (
    *("observation_names", "observation_units", "action_names", "action_units"),
    *("action_low", "action_high", "control_period"),
    *("observation_low", "observation_high", "joint_names", "joint_low", "joint_high"),
)
"""What a controller's user must know of the robot; attributes of a task's spec, and of a served controller."""


@dataclass(frozen=True)
class Source:
    """Elites of a stored run.

    Attributes:
        run: The run.
        cells: Cells whose elites are exported, ascending.
        one: Whether a single one was chosen.
    """

    run: StoredRun
    cells: tuple[int, ...]
    one: bool

    @classmethod
    def load(
        cls,
        path: Path,
        *,
        cell: int | None = None,
        best: bool = False,
        evaluation: int | None = None,
        single: bool = False,
    ) -> Source:
        """Read a run, finished or growing.

        Args:
            path: Folder of the run, or its repertoire file.
            cell: The cell whose elite is wanted.
            best: Whether the fittest is wanted.
            single: Whether the fittest is so by its single evaluation, rather than by the means of re-evaluations where
                there are any.
            evaluation: Evaluation id of the elite that is wanted. Without any of the three, all are.

        Raises:
            StorageError: There is no run, it is damaged, or it holds no behavior yet.
            ArchiveError: There is no such cell.
            NotFoundError: The cell is empty, or the controller of the evaluation is not an elite.
        """
        run = StoredRun.load(path)
        choices = run.choices(Demands(Judging.of(single=single)))
        if best:
            return cls(run, (choices.fittest(),), one=True)
        if cell is not None:
            return cls(run, (choices.of_cell(cell),), one=True)
        if evaluation is not None:
            return cls(run, (choices.of_evaluation(evaluation),), one=True)
        return cls(run, tuple(choices.cells().tolist()), one=False)

    def elites(self) -> Iterator[Elite]:
        """Yield the chosen elites, in the order of their cells."""
        return (self.run.archive.elite(cell) for cell in self.cells)

    def about(self, elite: Elite) -> dict[str, str]:
        """Return what a controller's user must know, as text by name; lists and numbers are JSON."""
        behavior = self.run.behavior(elite.cell)
        return about_robot(self.run) | about_behavior(behavior, self.run.shape.sizes)


def about_robot(run: StoredRun) -> dict[str, str]:
    """Return what the user of any controller of a run must know, as text by name; lists and numbers are JSON."""
    spec = run.spec
    known = {name: getattr(spec, name) for name in OF_ROBOT}
    return described(
        spec.name, run.info.run_id, {"descriptor_names": spec.descriptor_names, **known}
    )


def described(task: str, run_id: str, known: Mapping[str, Any]) -> dict[str, str]:
    """Return the description of a robot as text by name.

    Args:
        task: Name of its task.
        run_id: Id of the run.
        known: The names of the descriptor, and `OF_ROBOT`, fit for JSON.
    """
    return {"task": task, "run_id": run_id, "layout": LAYOUT} | _as_json(known)


def about_behavior(behavior: KnownBehavior, layer_sizes: Sequence[int]) -> dict[str, str]:
    """Return what is known of a behavior, stored or served, as text by name; lists and numbers are JSON."""
    known: dict[str, Any] = {
        "cell": behavior.cell,
        "evaluation": behavior.evaluation,
        "fitness": behavior.fitness,
        "descriptor": behavior.descriptor.tolist(),
        "layer_sizes": layer_sizes,
        "repeats": behavior.repeats,
    }
    if behavior.repeats:
        known["mean_fitness"] = behavior.mean_fitness
        known["mean_descriptor"] = behavior.mean_descriptor.tolist()
        known["fall_share"] = behavior.fall_share
    if behavior.repeats > 1:
        known["fitness_spread"] = behavior.fitness_spread
        known["descriptor_spread"] = behavior.descriptor_spread.tolist()
    return _as_json(known)


def _as_json(known: Mapping[str, Any]) -> dict[str, str]:
    return {name: json.dumps(value) for name, value in known.items()}
