"""A stored run, read from its folder or repertoire file; every program reads runs with this."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.choosing import Choices
from pga_me_ros.core.archive.elites import NO_PARENT, Elite
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.npz import repertoire_arrays
from pga_me_ros.core.storage.reevaluations import Reevaluations, Statistics
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import Generation
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import RequestError, SettingsError, StorageError
from pga_me_ros.tasks.spec import TaskSpec

REPERTOIRE = "repertoire.db"
"""Name of the repertoire file in the folder of a run."""

_ZIP = b"PK"


def repertoire_file(path: str | Path) -> Path:
    """Return the repertoire file of a path: the one in a run's folder, or the file itself."""
    path = Path(path)
    return path / REPERTOIRE if path.is_dir() else path


def is_exported(file: Path) -> bool:
    """Whether a file is a zip archive, as ``export --to npz`` writes them."""
    try:
        with file.open("rb") as content:
            return content.read(len(_ZIP)) == _ZIP
    except OSError:
        return False  # opening it as a repertoire will report what is wrong


@dataclass(frozen=True, eq=False)
class StoredBehavior:
    """An elite of a stored run, ready to run.

    Attributes:
        cell: Its cell in the archive.
        evaluation: Id of the evaluation that gave fitness and descriptor.
        fitness: Sum of rewards in that evaluation.
        descriptor: (d,) float64 achieved descriptor.
        distance: Euclidean distance from the requested descriptor, 0 if none was given.
        generation: Generation in which it was made.
        made_by: Operator that made it, for example ``pg``.
        parents: Evaluation ids of its parents, at most two.
        steps: Length of that evaluation, control steps.
        terminated: Whether that evaluation ended in a fall.
        parameters: (P,) float32; per layer the weights (out, in) row by row, then the biases.
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32 within ±1.
    """

    cell: int
    evaluation: int
    fitness: float
    descriptor: Float64Array
    distance: float
    generation: int
    made_by: str
    parents: tuple[int, ...]
    steps: int
    terminated: bool
    parameters: Float32Array
    controller: Callable[[Float32Array], Float32Array]


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A run, finished or growing, in its state when it was read.

    Attributes:
        file: Its repertoire file.
        info: What the file says about the run: its id, task, library versions.
        settings: Settings that the run was started with.
        spec: Its task.
        generations: Metrics, rates and time of every generation.
        reevaluations: Re-evaluations of elites (``reevaluate``).
    """

    file: Path
    info: RunInfo
    settings: Settings
    spec: TaskSpec
    generations: tuple[Generation, ...]
    reevaluations: Reevaluations

    @classmethod
    def load(cls, path: str | Path, *, elites: bool = True) -> Self:
        """Read a run.

        Args:
            path: Folder of the run, or its repertoire file.
            elites: Whether to read the archive now, and require that it holds a behavior. Otherwise the archive is read
                on first use.

        Raises:
            StorageError: There is no run, it is damaged or of another version, or it holds no behavior yet.
        """
        file = repertoire_file(path)
        if is_exported(file):
            raise StorageError(
                f"'{file}' is an exported file; give the folder of the run, or load its arrays with numpy.load."
            )
        with Repertoire.open(file, read_only=True) as repertoire:
            info, generations = repertoire.info, tuple(repertoire.generations())
            archive = repertoire.load_archive() if elites else None
        spec = TaskSpec.from_json(info.task)
        rows = Reevaluations.load(file, info.run_id, spec.descriptor_dim)
        run = cls(file, info, _settings(file, info), spec, generations, rows)
        if archive is not None:
            if not len(archive):
                raise StorageError(f"'{file}' holds no behavior yet; run it for longer first.")
            run.__dict__["archive"] = archive
        return run

    @cached_property
    def archive(self) -> Archive:
        """The archive after the last generation."""
        with Repertoire.open(self.file, read_only=True) as repertoire:
            return repertoire.load_archive()

    @cached_property
    def statistics(self) -> Statistics:
        """Mean and spread of the re-evaluations of each cell's elite."""
        return self.reevaluations.statistics(self.archive)

    @property
    def name(self) -> str:
        """Name of the run's folder."""
        return self.file.absolute().parent.name

    @property
    def shape(self) -> MlpShape:
        """Layers of the controllers."""
        return MlpShape(self.info.layer_sizes)

    @property
    def metrics(self) -> list[Metrics]:
        """Metrics of every generation."""
        return [generation.metrics for generation in self.generations]

    def curve(self, name: str) -> Float64Array:
        """Return one metric of every generation, for example ``qd_score``: (generations,) float64."""
        return np.array([getattr(m, name) for m in self.metrics], np.float64)

    def bests(self) -> list[Elite]:
        """Read every elite that was the best one after some generation, in the order they were found.

        Raises:
            StorageError: The file is damaged.
        """
        with Repertoire.open(self.file, read_only=True) as repertoire:
            return repertoire.bests()

    def arrays(self, cells: Sequence[int] | None = None) -> dict[str, NDArray[Any]]:
        """Return elites as arrays by name, one row each; docs/export.md lists them.

        Args:
            cells: Filled cells, None for all.
        """
        rows = self.archive.filled_cells() if cells is None else np.asarray(cells, np.int64)
        arrays = repertoire_arrays(self.info, self.archive, rows.tolist())
        if self.statistics.repeats.any():
            arrays |= {name: values[rows] for name, values in vars(self.statistics).items()}
        return arrays

    def choices(self, min_fitness: float | None = None, by_mean: bool = False) -> Choices:
        """Return the elites to choose from.

        Args:
            min_fitness: Minimum fitness, None for any.
            by_mean: Whether elites are judged by their means over re-evaluations; those without any are left out.

        Raises:
            NotFoundError: `by_mean` is set, but no elite was re-evaluated.
        """
        elites = self.statistics.as_elites(self.archive) if by_mean else self.archive
        least = -math.inf if min_fitness is None else min_fitness
        return Choices(self.archive, elites, self.spec.descriptor_names, least)

    def behavior(self, cell: int, distance: float = 0.0) -> StoredBehavior:
        """Return the behavior of a cell.

        Raises:
            ArchiveError: There is no such cell, or it is empty.
        """
        elite = self.archive.elite(cell)
        values = {f.name: getattr(elite, f.name) for f in dataclasses.fields(elite)}
        wanted = {f.name for f in dataclasses.fields(StoredBehavior)} & values.keys()
        return StoredBehavior(
            **{name: values[name] for name in wanted},
            distance=distance,
            made_by=elite.operator.label,
            parents=tuple(p for p in (elite.parent1, elite.parent2) if p != NO_PARENT),
            controller=MlpController(self.shape, elite.parameters),
        )

    def choose(
        self,
        *,
        descriptor: Sequence[float] | None = None,
        cell: int | None = None,
        best: bool = False,
        random: bool = False,
        max_distance: float | None = None,
        min_fitness: float | None = None,
        by_mean: bool = False,
    ) -> StoredBehavior:
        """Return a behavior; the arguments are those of `pga_me_ros.client.RepertoireClient.get_behavior`.

        Args:
            descriptor: d numbers; chooses the behavior nearest to it.
            cell: Number of a cell; chooses the behavior of this cell.
            best: Chooses the fittest behavior; the default.
            random: Chooses a random behavior.
            max_distance: Maximum distance to `descriptor`, None for any.
            min_fitness: Minimum fitness, None for any.
            by_mean: Whether to judge behaviors by their means over re-evaluations; those without any are left out.

        Raises:
            RequestError: More than one way to choose is given, or the descriptor has the wrong length.
            ArchiveError: There is no such cell, or a number is NaN or infinite.
            NotFoundError: No behavior fits.
        """
        ways = {"descriptor": descriptor is not None, "cell": cell is not None}
        ways |= {"best": best, "random": random}
        given = [name for name, is_given in ways.items() if is_given]
        if len(given) > 1:
            raise RequestError(
                f"Choose a behavior in one way: descriptor, cell, best or random; given: {', '.join(given)}."
            )
        if max_distance is not None and descriptor is None:
            raise RequestError(
                f"max_distance is {max_distance}; give it together with a descriptor."
            )
        choices = self.choices(min_fitness, by_mean)
        if descriptor is not None:
            farthest = math.inf if max_distance is None else max_distance
            cells, distances = choices.nearest(descriptor, 1, farthest)
            return self.behavior(int(cells[0]), float(distances[0]))
        if cell is not None:
            return self.behavior(choices.of_cell(cell))
        if random:  # not part of a run, so it need not be repeatable
            return self.behavior(choices.any(np.random.default_rng()))
        return self.behavior(choices.fittest())


def _settings(file: Path, info: RunInfo) -> Settings:
    try:
        return Settings.from_stored(info.settings)
    except SettingsError as error:
        raise StorageError(
            f"The settings of '{file}' cannot be read ({error}). Use the pga_me_ros that wrote it."
        ) from None
