"""The matrix of an experiment: which runs it consists of, and where each of them is."""

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
from pga_me_ros.tasks.registry import task_spec

COPY = "experiment.yaml"
"""Copy of the experiment file in the experiment's folder, for the report."""

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""What can be part of a ROS namespace, and of a path anywhere."""


@dataclass(frozen=True)
class System:
    """What is compared with others.

    Attributes:
        name: Its name in tables and pictures.
        settings: The settings that make it what it is, by name.
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
    """

    index: int
    system: str
    task: str
    seed: int
    given: Mapping[str, Any] = field(compare=False)

    @property
    def name(self) -> str:
        """SYSTEM/TASK/SEED."""
        return f"{self.system}/{short_name(self.task)}/{self.seed}"

    @property
    def settings(self) -> Settings:
        """All settings of the run.

        Raises:
            SettingsError: One is unknown or has a value that makes no sense.
        """
        return Settings.from_mapping(dict(self.given))

    def folder(self, experiment: Path) -> Path:
        """Return the folder of the run within that of the experiment."""
        return experiment / self.system / short_name(self.task) / f"seed{self.seed}"

    def namespace(self, experiment: str) -> str:
        """Return the ROS namespace of the run: no two runs of an experiment hear each other."""
        name = re.sub(r"\W", "_", experiment, flags=re.ASCII)
        head = name if NAME.fullmatch(name) else f"e_{name}"
        return f"/{head}/{self.system}/{short_name(self.task)}/seed{self.seed}"


def short_name(task: str) -> str:
    """Return a task's name without the module that it is in."""
    return re.sub(r"\W", "_", task.rpartition(":")[2], flags=re.ASCII)


@dataclass(frozen=True)
class Experiment:
    """What an experiment file asks for.

    Attributes:
        systems: What is compared.
        tasks: On which tasks, as the setting of that name takes them.
        seeds: Seeds of the runs of each system on each task.
        budget: Evaluations of each run.
        settings: Settings that all runs share.
        reference: Name of the system with which the others are compared.
    """

    systems: tuple[System, ...]
    tasks: tuple[str, ...]
    seeds: tuple[int, ...]
    budget: int
    settings: Mapping[str, Any]
    reference: str

    @property
    def cells(self) -> list[Cell]:
        """All runs, seed by seed, so that what is done first can be compared first."""
        places = [
            (system, task, seed)
            for seed in self.seeds
            for task in self.tasks
            for system in self.systems
        ]
        return [
            Cell(index, system.name, task, seed, self._given(system, task, seed))
            for index, (system, task, seed) in enumerate(places)
        ]

    def _given(self, system: System, task: str, seed: int) -> dict[str, Any]:
        own = {"task": task, "seed": seed, "evaluations": self.budget}
        return {**self._shared(system), **system.settings, **own}

    def _shared(self, system: System) -> dict[str, Any]:
        """Return the shared settings that a system uses: networks of critics, say, mean nothing to MAP-Elites."""
        both = {**self.settings, **system.settings}
        algorithm = both.get("algorithm", Settings.algorithm)
        unused = useless(self.settings, algorithm, both.get("archive", Settings.archive))
        return {name: value for name, value in self.settings.items() if name not in unused}

    def chosen(self, words: list[str]) -> list[Cell]:
        """Return the cells that words name, in the order of the matrix.

        Args:
            words: Indices, names SYSTEM/TASK/SEED, or patterns such as ``td3/*/1``; none for all.

        Raises:
            RequestError: A word names no cell.
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
            SettingsError: A name or setting makes no sense.
            TaskError: A task is unknown.
        """
        for system in self.systems:
            if not isinstance(system.name, str) or not NAME.fullmatch(system.name):
                raise SettingsError(
                    f"the system {system.name!r} has a name that is no part of a ROS namespace; use letters, digits "
                    "and underscores, a letter first."
                )
        named: dict[str, str] = {}
        for task in self.tasks:
            for name in {task_spec(task).name, short_name(task)}:
                if named.setdefault(name, task) != task:
                    raise SettingsError(
                        f"the tasks '{named[name]}' and '{task}' are both called '{name}'; runs of different tasks "
                        "cannot be told apart by it: leave one out."
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
                    f"the budget of {self.budget} evaluations is spent on the {settings.random_init} random controllers"
                    f" that system '{cell.system}' begins with (random_init, G); give more."
                )
            if settings in same:
                raise SettingsError(
                    f"the systems '{same[settings]}' and '{cell.system}' have the same settings; leave one out or say "
                    "what the difference is."
                )
            same[settings] = cell.system
