"""What an export takes from a run: its description, its archive, and the chosen elites."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pga_me_ros.core.archive.choosing import Demands, Judging
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.storage.npz import LAYOUT
from pga_me_ros.core.storage.stored_run import StoredRun


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
        statistics = self.run.statistics
        repeats = int(statistics.repeats[elite.cell])
        means = {
            "mean_fitness": float(statistics.mean_fitness[elite.cell]),
            "mean_descriptor": statistics.mean_descriptor[elite.cell].tolist(),
            "fall_share": float(statistics.fall_share[elite.cell]),
        }
        if repeats > 1:
            means["fitness_spread"] = float(statistics.fitness_spread[elite.cell])
            means["descriptor_spread"] = statistics.descriptor_spread[elite.cell].tolist()
        own = {
            "cell": elite.cell,
            "evaluation": elite.evaluation,
            "fitness": elite.fitness,
            "descriptor": elite.descriptor.tolist(),
            "layer_sizes": self.run.shape.sizes,
            "repeats": repeats,
            **(means if repeats else {}),
        }
        return about_robot(self.run) | {name: json.dumps(value) for name, value in own.items()}


def about_robot(run: StoredRun) -> dict[str, str]:
    """Return what the user of any controller of a run must know, as text by name; lists and numbers are JSON."""
    spec = run.spec
    known = {
        "descriptor_names": spec.descriptor_names,
        "observation_names": spec.observation_names,
        "observation_units": spec.observation_units,
        "action_names": spec.action_names,
        "action_units": spec.action_units,
        "action_low": spec.action_low,
        "action_high": spec.action_high,
        "control_period": spec.control_period,
    }
    text = {name: json.dumps(value) for name, value in known.items()}
    return {"task": spec.name, "run_id": run.info.run_id, "layout": LAYOUT} | text
