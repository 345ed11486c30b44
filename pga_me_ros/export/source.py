"""What an export takes from a run: its description, its archive, and the elites that were asked for."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.elites import Elite
from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.reevaluations import Reevaluations, Statistics
from pga_me_ros.core.repertoire_arrays import LAYOUT
from pga_me_ros.core.run_directory import REPERTOIRE
from pga_me_ros.core.run_info import RunInfo
from pga_me_ros.core.storage import Repertoire
from pga_me_ros.tasks.spec import TaskSpec


@dataclass(frozen=True)
class Source:
    """Elites of a stored run.

    Attributes:
        name: Name of the run's folder.
        info: Description of the run.
        spec: Its task.
        shape: Layers of its controllers.
        archive: Its archive.
        statistics: Mean and spread of re-evaluations.
        cells: Cells whose elites are to be exported, ascending.
        one: Whether a single one was asked for.
    """

    name: str
    info: RunInfo
    spec: TaskSpec
    shape: MlpShape
    archive: Archive
    statistics: Statistics
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
    ) -> Source:
        """Read a run, finished or under way.

        Args:
            path: Folder of the run, or its repertoire file.
            cell: The cell whose elite is wanted.
            best: Whether the fittest is wanted.
            evaluation: Evaluation id of the elite that is wanted. Without any of the three, all are.

        Raises:
            StorageError: There is none, or it is damaged.
            RequestError: It has no such elite.
            ArchiveError: There is no such cell, or it is empty.
        """
        file = path / REPERTOIRE if path.is_dir() else path
        with Repertoire.open(file, read_only=True) as repertoire:
            info, archive = repertoire.info, repertoire.load_archive()
        if not len(archive):
            raise RequestError(f"'{file}' holds no controller yet; run it for longer first.")
        again = Reevaluations.load(file, info.run_id, archive.dimensions)
        one = _one(archive, cell, best, evaluation)
        return cls(
            name=file.absolute().parent.name,
            info=info,
            spec=TaskSpec.from_json(info.task),
            shape=MlpShape(info.layer_sizes),
            archive=archive,
            statistics=again.statistics(archive),
            cells=tuple(archive.filled_cells().tolist()) if one is None else (one,),
            one=one is not None,
        )

    def elites(self) -> Iterator[Elite]:
        """Yield the elites that were asked for, in the order of their cells."""
        return (self.archive.elite(cell) for cell in self.cells)

    def about(self, elite: Elite) -> dict[str, str]:
        """Return what a controller's user must know, as text by name; lists and numbers are JSON."""
        spec = self.spec
        known = {
            "cell": elite.cell,
            "evaluation": elite.evaluation,
            "fitness": elite.fitness,
            "descriptor": elite.descriptor.tolist(),
            "descriptor_names": spec.descriptor_names,
            "observation_names": spec.observation_names,
            "observation_units": spec.observation_units,
            "action_names": spec.action_names,
            "action_units": spec.action_units,
            "action_low": spec.action_low,
            "action_high": spec.action_high,
            "control_period": spec.control_period,
            "layer_sizes": self.shape.sizes,
        }
        text = {name: json.dumps(value) for name, value in known.items()}
        return {"task": spec.name, "run_id": self.info.run_id, "layout": LAYOUT} | text


def _one(archive: Archive, cell: int | None, best: bool, evaluation: int | None) -> int | None:
    """Return the cell of the single elite that was asked for, None for all."""
    if best:
        return archive.best().cell
    if cell is not None:
        return archive.elite(cell).cell
    if evaluation is None:
        return None
    found = np.flatnonzero(archive.filled & (archive.evaluations == evaluation))
    if not len(found):
        raise RequestError(
            f"The controller of evaluation {evaluation} is no elite, so it was not kept; --to csv lists those that are."
        )
    return int(found[0])
