"""What a report reads of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.errors import StorageError
from pga_me_ros.core.metrics import Metrics
from pga_me_ros.core.run_directory import REPERTOIRE
from pga_me_ros.core.storage import Repertoire
from pga_me_ros.tasks.spec import TaskSpec


@dataclass(frozen=True)
class StoredRun:
    """A run as its repertoire file tells it.

    Attributes:
        name: Name of the run's folder.
        spec: Task.
        seed: Seed of the run.
        archive: The archive after the last generation.
        metrics: Metrics of every generation.
    """

    name: str
    spec: TaskSpec
    seed: int
    archive: Archive
    metrics: list[Metrics]

    @classmethod
    def load(cls, path: Path) -> StoredRun:
        """Read a run.

        Args:
            path: Folder of the run, or its repertoire file.

        Raises:
            StorageError: There is none, it is damaged, or it has no generation yet.
        """
        file = path / REPERTOIRE if path.is_dir() else path
        with Repertoire.open(file, read_only=True) as repertoire:
            info, metrics = repertoire.info, repertoire.metrics()
            archive = repertoire.load_archive()
        if not metrics:
            raise StorageError(f"'{file}' has no generation yet; run it for longer first.")
        spec = TaskSpec.from_json(info.task)
        return cls(file.parent.name, spec, int(info.settings["seed"]), archive, metrics)

    def curve(self, name: str) -> NDArray[np.float64]:
        """Return one metric of every generation: (generations,) float64."""
        return np.array([getattr(m, name) for m in self.metrics], np.float64)
