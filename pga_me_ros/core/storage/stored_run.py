"""A stored run, read from its folder or repertoire file; every program reads runs with this."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arguments import number, numbers, whole_number
from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.choosing import Choices, Demands, Judging
from pga_me_ros.core.archive.corrected import CorrectedMetrics, complete_metrics
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.archive.worlds import Worlds
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.npz import repertoire_arrays
from pga_me_ros.core.storage.reevaluations import Reevaluations
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import Generation
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.core.storage.shipped import REPERTOIRE, located
from pga_me_ros.core.storage.stored_behavior import StoredBehavior
from pga_me_ros.core.storage.stored_worlds import worlds_of
from pga_me_ros.errors import RequestError, SettingsError, StorageError
from pga_me_ros.tasks.spec import TaskSpec

__all__ = ["REPERTOIRE", "StoredBehavior", "StoredRun", "is_exported", "repertoire_file"]

ANY = Demands()
"""No demands: the best that is known of each elite counts."""

_ZIP = b"PK"


def repertoire_file(path: str | Path) -> Path:
    """Return the repertoire file that a user means: that of a folder, a shipped one (``zoo/NAME``), or the file itself.

    Raises:
        StorageError: It is the name of a shipped repertoire, but there is none of that name.
    """
    path = located(Path(path))
    return path / REPERTOIRE if path.is_dir() else path


def is_exported(file: Path) -> bool:
    """Whether a file is a zip archive, as ``export --to npz`` writes them."""
    try:
        with file.open("rb") as content:
            return content.read(len(_ZIP)) == _ZIP
    except OSError:
        return False  # opening it as a repertoire will report what is wrong


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
            info, archive = repertoire.info, None
            if elites:
                generations, archive = repertoire.load_state()
            else:
                generations = repertoire.generations()
        spec = TaskSpec.from_json(info.task)
        rows = Reevaluations.load(file, info.run_id, spec.descriptor_dim)
        run = cls(file, info, _settings(file, info), spec, tuple(generations), rows)
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
    def elsewhere(self) -> tuple[Reevaluations, ...]:
        """Re-evaluations in which other things were randomized than in the run."""
        return Reevaluations.load_elsewhere(self.file, self.info.run_id, self.spec.descriptor_dim)

    @cached_property
    def worlds(self) -> Worlds | None:
        """What elites achieve in other worlds, by their re-evaluations there; None without any."""
        return worlds_of(self.elsewhere)

    def require_worlds(self, asked: str) -> Worlds:
        """Return `worlds`.

        Args:
            asked: What asks for them, for the message.

        Raises:
            RequestError: There are none.
        """
        if self.worlds is None:
            raise RequestError(
                f"{asked}: the behaviors of '{self.name}' were not evaluated in another world; do so first (reevaluate "
                f"{self.file.parent} --randomization TEXT), or leave it out."
            )
        return self.worlds

    @cached_property
    def statistics(self) -> Statistics:
        """Mean and spread of the re-evaluations of each cell's elite."""
        return self.reevaluations.statistics(self.archive)

    @cached_property
    def corrected(self) -> CorrectedMetrics | None:
        """Measures of the archive by re-evaluations, None if not all of its elites were re-evaluated."""
        return complete_metrics(self.archive, self.statistics)

    @property
    def is_thinned(self) -> bool:
        """Whether it is a part of a run's elites, as `thin` keeps it, without the generations that led to them."""
        first = self.metrics[0]
        return len(self.metrics) == 1 and first.evaluations > sum(first.offspring)

    @property
    def name(self) -> str:
        """Name of the run's folder, or of the shipped repertoire."""
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

    def choices(self, demands: Demands = ANY) -> Choices:
        """Return the elites to choose from.

        Args:
            demands: What they are judged by, and limits.

        Raises:
            NotFoundError: By their means alone, but none was re-evaluated.
        """
        return Choices(self.archive, self.statistics, self.spec.descriptor_names, demands)

    def behavior(self, cell: int, distance: float = 0.0, demands: Demands = ANY) -> StoredBehavior:
        """Return the behavior of a cell.

        Args:
            cell: Its cell.
            distance: Its distance to the descriptor that was asked for.
            demands: What it was judged by.

        Raises:
            ArchiveError: There is no such cell, or it is empty.
        """
        return StoredBehavior.chosen(self.choices(demands), cell, self.shape, distance)

    def choose(
        self,
        *,
        descriptor: Sequence[float] | None = None,
        cell: int | None = None,
        best: bool = False,
        random: bool = False,
        max_distance: float | None = None,
        min_fitness: float | None = None,
        max_fall_share: float | None = None,
        by_mean: bool = False,
        single: bool = False,
    ) -> StoredBehavior:
        """Return a behavior; the arguments are those of `pga_me_ros.client.RepertoireClient.get_behavior`.

        Behaviors are judged by the means of their re-evaluations where they have any, else by their single evaluation.

        Args:
            descriptor: d numbers: the behavior nearest to it.
            cell: Number of a cell: the behavior of this cell.
            best: The fittest; also if nothing else is asked for.
            random: Any.
            max_distance: Greatest distance to `descriptor`, None for any.
            min_fitness: Least fitness, None for any.
            max_fall_share: Greatest share of its re-evaluations that ended in a fall, None for any.
            by_mean: Whether behaviors without re-evaluations are left out.
            single: Whether all are judged by their single evaluation.

        Raises:
            RequestError: More than one way to choose is given, arguments contradict each other, or the descriptor has
                the wrong length.
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
        choices = self.choices(
            Demands(
                Judging.of(by_mean=by_mean, single=single),
                -math.inf if min_fitness is None else number("min_fitness", min_fitness),
                math.inf if max_fall_share is None else number("max_fall_share", max_fall_share),
            )
        )
        distance = 0.0
        if descriptor is not None:
            farthest = math.inf if max_distance is None else max_distance
            cells, distances = choices.nearest(
                numbers("descriptor", descriptor), 1, number("max_distance", farthest)
            )
            chosen, distance = int(cells[0]), float(distances[0])
        elif cell is not None:
            chosen = choices.of_cell(whole_number("cell", cell))
        elif random:  # what is looked at next is no part of a run, so it need not be repeatable
            chosen = choices.any(np.random.default_rng())
        else:
            chosen = choices.fittest()
        return StoredBehavior.chosen(choices, chosen, self.shape, distance)


def _settings(file: Path, info: RunInfo) -> Settings:
    try:
        return Settings.from_stored(info.settings)
    except SettingsError as error:
        raise StorageError(
            f"The settings of '{file}' cannot be read ({error}). Use the pga_me_ros that wrote it."
        ) from None
