"""What a comparison reads of a run: its metrics of section 4.4 (Nilsson & Cully 2021) at every generation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.errors import StorageError
from pga_me_ros.core.fitness_difference import fitness_differences
from pga_me_ros.core.reevaluations import Reevaluations
from pga_me_ros.core.run_directory import REPERTOIRE
from pga_me_ros.core.storage import Repertoire
from pga_me_ros.tasks.spec import TaskSpec

FIRST_SYSTEM = "pga_map_elites"
"""What runs are of that were stored before there was a choice."""

Curve = NDArray[np.float64]


@dataclass(frozen=True)
class ComparedRun:
    """A run without its archive: of hundreds, not all fit into memory.

    Attributes:
        system: Name of the system.
        spec: Task.
        seed: Seed of the run.
        file: Its repertoire file.
        evaluations: (generations,) float64 evaluations after each generation.
        lowest_fitness: Lowest fitness of an elite in any of its generations.
        curves: (generations,) float64 each: qd_score (without offset), coverage, max_fitness and fitness_difference,
            the latter NaN where it is not known.
    """

    system: str
    spec: TaskSpec
    seed: int
    file: Path
    evaluations: Curve
    lowest_fitness: float
    curves: Mapping[str, Curve]

    @classmethod
    def load(cls, path: Path, system: str = "") -> ComparedRun:
        """Read a run.

        Args:
            path: Folder of the run, or its repertoire file.
            system: Name of the system; empty takes the run's `algorithm`.

        Raises:
            StorageError: There is none, it is damaged, or it has no generation yet.
        """
        file = path / REPERTOIRE if path.is_dir() else path
        with Repertoire.open(file, read_only=True) as repertoire:
            info, metrics = repertoire.info, repertoire.metrics()
            if not metrics:
                raise StorageError(f"'{file}' has no generation yet; run it for longer first.")
            spec = TaskSpec.from_json(info.task)
            lowest = np.array([m.min_fitness for m in metrics])
            if np.isnan(lowest).any():  # an older program stored it: what is left of it tells
                lowest = np.append(lowest, repertoire.load_archive().min_fitness)
            rows = Reevaluations.load(file, info.run_id, spec.descriptor_dim)
        names = ("qd_score", "coverage", "max_fitness")
        curves = {n: np.array([getattr(m, n) for m in metrics], np.float64) for n in names}
        return cls(
            system=system or str(info.settings.get("algorithm", FIRST_SYSTEM)),
            spec=spec,
            seed=int(info.settings["seed"]),
            file=file,
            evaluations=np.array([m.evaluations for m in metrics], np.float64),
            lowest_fitness=float(np.nanmin(lowest)),
            curves={**curves, "fitness_difference": fitness_differences(metrics, rows)},
        )

    def load_archive(self) -> Archive:
        """Return the archive after the last generation.

        Raises:
            StorageError: It is damaged.
        """
        with Repertoire.open(self.file, read_only=True) as repertoire:
            return repertoire.load_archive()

    def at(self, evaluations: Curve, metric: str, offset: float) -> Curve:
        """Return a metric as it was after so many evaluations: that of the last generation within them.

        Args:
            evaluations: (n,) numbers of evaluations, none below those of the first generation.
            metric: A key of `curves`.
            offset: Fitness that QD-scores are measured from.

        Returns:
            (n,) float64.
        """
        values = self.curves[metric]
        if metric == "qd_score":
            values = values - offset * self.curves["coverage"]
        places = np.searchsorted(self.evaluations, evaluations, side="right") - 1
        return values[np.maximum(places, 0)]
