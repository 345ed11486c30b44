"""The matrix of an experiment: its runs and their folders."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.rules import useless
from pga_me_ros.errors import RequestError, SettingsError, nearest_name
from pga_me_ros.tasks.registry import randomization_option, task_spec

COPY = "experiment.yaml"
"""Copy of the experiment file in the experiment's folder, for the report."""

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""Names that are valid in a ROS namespace, and in paths on any system."""


@dataclass(frozen=True)
class System:
    """One of the systems that are compared.

    Attributes:
        name: Its name in tables and pictures.
        settings: The settings that define it, by name.
    """

    name: str
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Cell:
    """One run of the matrix.

    Attributes:
        index: Its place in the matrix, from 0.
        system: Name of the system.
        task: Name of the task as a setting.
        seed: Seed.
        given: The settings that the experiment gives it, by name; all others have their defaults.
        reevaluations: Evaluations of each elite from other initial poses once the budget is reached.
    """

    index: int
    system: str
    task: str
    seed: int
    given: Mapping[str, Any] = field(compare=False)
    reevaluations: int = 0

    @property
    def name(self) -> str:
        """SYSTEM/TASK/SEED."""
        return f"{self.system}/{short_name(self.task)}/{self.seed}"

    @property
    def settings(self) -> Settings:
        """All settings of the run.

        Raises:
            SettingsError: A setting is unknown or has an invalid value.
        """
        return Settings.from_mapping(dict(self.given))

    def folder(self, experiment: Path) -> Path:
        """Return the folder of the run within the folder of the experiment."""
        return experiment / self.system / short_name(self.task) / f"seed{self.seed}"

    def namespace(self, experiment: str) -> str:
        """Return the ROS namespace of the run, which separates it from the experiment's other runs."""
        name = re.sub(r"\W", "_", experiment, flags=re.ASCII)
        head = name if NAME.fullmatch(name) else f"e_{name}"
        return f"/{head}/{self.system}/{short_name(self.task)}/seed{self.seed}"


def short_name(task: str) -> str:
    """Return a task's name without its module."""
    return re.sub(r"\W", "_", task.rpartition(":")[2], flags=re.ASCII)


@dataclass(frozen=True)
class Experiment:
    """The content of an experiment file.

    Attributes:
        systems: The systems that are compared.
        tasks: Names of the tasks, as for the setting `task`.
        seeds: Seeds of the runs of each system on each task.
        budget: Number of evaluations of each run.
        settings: Settings that all runs share.
        reference: Name of the system with which the others are compared.
        reevaluations: Evaluations of each elite of a finished run from other initial poses, for the corrected measures.
    """

    systems: tuple[System, ...]
    tasks: tuple[str, ...]
    seeds: tuple[int, ...]
    budget: int
    settings: Mapping[str, Any]
    reference: str
    reevaluations: int = 0

    @property
    def cells(self) -> list[Cell]:
        """All runs, seed by seed, so that complete comparisons are done first."""
        places = [
            (system, task, seed)
            for seed in self.seeds
            for task in self.tasks
            for system in self.systems
        ]
        return [
            Cell(
                index, system.name, task, seed, self._given(system, task, seed), self.reevaluations
            )
            for index, (system, task, seed) in enumerate(places)
        ]

    def _given(self, system: System, task: str, seed: int) -> dict[str, Any]:
        own = {"task": task, "seed": seed, "evaluations": self.budget}
        return {**self._shared(system), **system.settings, **own}

    def _shared(self, system: System) -> dict[str, Any]:
        """Return the shared settings that a system uses: MAP-Elites, for example, has no use for those of critics."""
        both = {**self.settings, **system.settings}
        algorithm = both.get("algorithm", Settings.algorithm)
        unused = useless(self.settings, algorithm, both.get("archive", Settings.archive))
        return {name: value for name, value in self.settings.items() if name not in unused}

    def chosen(self, words: list[str]) -> list[Cell]:
        """Return the chosen cells, in the order of the matrix.

        Args:
            words: Indices, names SYSTEM/TASK/SEED, or patterns such as ``td3/*/1``; empty for all.

        Raises:
            RequestError: A word matches no cell.
        """
        cells = self.cells
        if not words:
            return cells
        found: set[int] = set()
        for word in words:
            matching = {c.index for c in cells if word == str(c.index) or fnmatchcase(c.name, word)}
            if not matching:
                near = nearest_name(word, [cell.name for cell in cells])
                raise RequestError(
                    f"There is no cell '{word}'{near}; give SYSTEM/TASK/SEED or an index from 0 to {len(cells) - 1} "
                    "(--list shows all)."
                )
            found |= matching
        return [cells[index] for index in sorted(found)]

    def check(self) -> None:
        """Check that every run can start and that they can be compared.

        Raises:
            SettingsError: A name or setting is invalid.
            TaskError: A task is unknown.
        """
        for system in self.systems:
            if not isinstance(system.name, str) or not NAME.fullmatch(system.name):
                raise SettingsError(
                    f"the system {system.name!r} has a name that is not valid in a ROS namespace; use letters, digits "
                    "and underscores, beginning with a letter."
                )
        named: dict[str, str] = {}
        for task in self.tasks:
            for name in {task_spec(task).name, short_name(task)}:
                if named.setdefault(name, task) != task:
                    raise SettingsError(
                        f"the tasks '{named[name]}' and '{task}' are both called '{name}', so their runs would share a "
                        "folder; remove one."
                    )
        self._check_settings()

    def _check_settings(self) -> None:
        used = {name for system in self.systems for name in self._shared(system)}
        for name in self.settings:
            if name not in used:
                raise SettingsError(
                    f"settings has {name}, but none of the systems uses it; remove {name}."
                )
        same: dict[Settings, str] = {}
        for cell in self.cells:
            try:
                settings = cell.settings
            except SettingsError as error:
                raise SettingsError(f"system '{cell.system}': {error}") from None
            if settings.generations <= settings.init_generations:
                raise SettingsError(
                    f"the budget of {self.budget} evaluations is used up by the {settings.random_init} random "
                    f"controllers that system '{cell.system}' starts with (random_init, G); give a larger budget."
                )
            randomization_option(cell.task, settings.randomization)
            if settings in same:
                raise SettingsError(
                    f"the systems '{same[settings]}' and '{cell.system}' have the same settings; remove one, or give "
                    "the settings in which they differ."
                )
            same[settings] = cell.system
