"""Gaits straight from a repertoire file, with nobody serving it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.errors import RequestError, StorageError
from pga_me_ros.core.policy import Controller, MlpShape
from pga_me_ros.core.run_directory import REPERTOIRE
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage import Repertoire
from pga_me_ros.tasks.protocol import Float32Array, Float64Array
from pga_me_ros.tasks.spec import TaskSpec


@dataclass(frozen=True, eq=False)
class Gait:
    """A behaviour to show.

    Attributes:
        cell: Its cell in the archive.
        evaluation: Id of the evaluation that the promise comes from.
        fitness: Promised fitness.
        descriptor: (d,) promised descriptor.
        distance: From its descriptor to the wanted one, 0 where none was wanted.
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32.
    """

    cell: int
    evaluation: int
    fitness: float
    descriptor: Float64Array
    distance: float
    controller: Callable[[Float32Array], Float32Array]

    @classmethod
    def of(cls, behavior: Any) -> Gait:
        """Return what a `pga_me_ros.client.Behavior` promises and does."""
        return cls(
            behavior.cell,
            behavior.evaluation,
            behavior.fitness,
            behavior.descriptor,
            behavior.distance,
            behavior.controller,
        )


@dataclass(frozen=True, eq=False)
class StoredRepertoire:
    """A repertoire as its file holds it.

    Attributes:
        name: Name of the run's folder.
        task: Name that the task is loaded by.
        settings: Settings of the run.
        spec: The task.
        archive: The archive.
    """

    name: str
    task: str
    settings: Settings
    spec: TaskSpec
    archive: Archive
    shape: MlpShape

    @classmethod
    def load(cls, path: Path) -> StoredRepertoire:
        """Read a repertoire, finished or growing.

        Args:
            path: Folder of the run, or its repertoire file.

        Raises:
            StorageError: There is none, it is damaged, or it holds no gait yet.
        """
        file = path / REPERTOIRE if path.is_dir() else path
        with Repertoire.open(file, read_only=True) as repertoire:
            info, archive = repertoire.info, repertoire.load_archive()
        if not len(archive):
            raise StorageError(f"'{file}' holds no gait yet; run it for longer first.")
        return cls(
            name=file.absolute().parent.name,
            task=str(info.settings["task"]),
            settings=Settings.from_mapping(info.settings),
            spec=TaskSpec.from_json(info.task),
            archive=archive,
            shape=MlpShape(tuple(info.layer_sizes)),
        )

    def gait(self, cell: int, distance: float = 0.0) -> Gait:
        """Return the gait of a cell.

        Raises:
            ArchiveError: There is no such cell, or it is empty.
        """
        elite = self.archive.elite(cell)
        controller = Controller(self.shape, elite.parameters)
        return Gait(cell, elite.evaluation, elite.fitness, elite.descriptor, distance, controller)

    def choose(
        self,
        *,
        descriptor: Sequence[float] | None = None,
        cell: int | None = None,
        random: bool = False,
        min_fitness: float | None = None,
    ) -> Gait:
        """Return the gait nearest to a descriptor, that of a cell, any, or, asked for none of these, the fittest.

        Args:
            descriptor: d numbers.
            cell: Number of a cell.
            random: Whether to take any.
            min_fitness: Least fitness, None for any.

        Raises:
            RequestError: None has the fitness, or the descriptor has the wrong length.
            ArchiveError: There is no such cell, or it is empty.
        """
        least = -math.inf if min_fitness is None else min_fitness
        fit = self.archive.filled_cells()
        fit = fit[self.archive.fitness[fit] >= least]
        if cell is not None:
            gait = self.gait(cell)
            if gait.fitness < least:
                raise RequestError(
                    f"The gait of cell {cell} has fitness {gait.fitness:.1f}, less than {least:.1f}."
                )
            return gait
        if not len(fit):
            raise RequestError(
                f"No gait has a fitness of {least:.1f} or more; the best has {self.archive.max_fitness:.1f}."
            )
        if descriptor is not None:
            return self._nearest(descriptor, least)
        if random:  # what is looked at next is no part of a run, so it need not be repeatable
            return self.gait(int(np.random.default_rng().choice(fit)))
        return self.gait(int(fit[np.argmax(self.archive.fitness[fit])]))

    def _nearest(self, descriptor: Sequence[float], least: float) -> Gait:
        wanted = np.asarray(descriptor, np.float64)
        if wanted.shape != (self.archive.dimensions,):
            raise RequestError(
                f"The descriptor has {wanted.size} entries; this repertoire's has {self.archive.dimensions}: "
                f"{', '.join(self.spec.descriptor_names)}."
            )
        cells, distances = self.archive.nearest(wanted, 1, math.inf, least)
        return self.gait(int(cells[0]), float(distances[0]))
