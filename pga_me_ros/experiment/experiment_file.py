"""Experiment files: YAML that describes a comparison; every mistake is reported before anything starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pga_me_ros.core.settings.rules import RULES
from pga_me_ros.core.storage.reevaluations import MOST_REPEATS
from pga_me_ros.errors import PgaError, SettingsError, nearest_name
from pga_me_ros.experiment.plan import Experiment, System
from pga_me_ros.yaml_files import read_yaml

KEYS = ("systems", "tasks", "seeds", "budget", "settings", "reference", "reevaluations")
LAYOUT = "expected the keys systems, tasks, seeds and budget; docs/experiment.md has an example"
OF_THE_MATRIX = {"task": "tasks", "seed": "seeds", "evaluations": "budget"}
"""Settings that the matrix decides, with the key that does."""


REFERENCE = "pga_map_elites"
"""Default reference system: p-values compare the others with it (section 4.4)."""


def read_experiment(path: Path) -> Experiment:
    """Read an experiment file and check all of it.

    Args:
        path: The file.

    Raises:
        SettingsError: The file is missing, is not YAML, or has an invalid key or value.
    """
    content = read_yaml(path, "experiment file", LAYOUT)
    try:
        return _experiment(content)
    except PgaError as error:
        raise SettingsError(f"Experiment file '{path}': {error}") from None


def _experiment(content: Any) -> Experiment:
    if not isinstance(content, Mapping):
        raise SettingsError(f"it is {_kind(content)}; {LAYOUT}.")
    for key in content:
        if key not in KEYS:
            raise SettingsError(f"unknown key '{key}'{nearest_name(str(key), KEYS)}; {LAYOUT}.")
    settings = _settings(content.get("settings") or {}, "settings")
    systems = _systems(content.get("systems"))
    tasks = _several(content.get("tasks"), "tasks", str, "qd_walker")
    seeds = _several(content.get("seeds"), "seeds", int, "1")
    budget = content.get("budget")
    if isinstance(budget, float) and budget.is_integer():
        budget = int(budget)  # so that 1e6 can be written
    if type(budget) is not int:
        raise SettingsError(
            f"budget is {_kind(budget)}; give the number of evaluations of each run, for example 20000."
        )
    names = [system.name for system in systems]
    reference = content.get("reference", REFERENCE if REFERENCE in names else names[0])
    if reference not in names:
        raise SettingsError(
            f"reference is {reference!r}{nearest_name(str(reference), names)}; give the system with which the others "
            f"are compared: {', '.join(names)}."
        )
    experiment = Experiment(
        systems,
        tuple(tasks),
        tuple(seeds),
        budget,
        settings,
        reference,
        _reevaluations(content.get("reevaluations", 0)),
    )
    experiment.check()
    return experiment


def _reevaluations(given: Any) -> int:
    if type(given) is not int or not 0 <= given <= MOST_REPEATS:
        raise SettingsError(
            f"reevaluations is {given!r}; give how often each elite of a finished run is re-evaluated, 0 to "
            f"{MOST_REPEATS:,}."
        )
    return given


def _systems(given: Any) -> tuple[System, ...]:
    """Return the systems: names of algorithms, or names with settings.

    A system with the name of an algorithm is that algorithm.
    """
    if isinstance(given, Mapping):
        pairs = list(given.items())
    else:
        names = _several(given, "systems", str, "pga_map_elites")
        pairs = [(name, {"algorithm": name}) for name in names]
    if not pairs:
        raise SettingsError("systems is empty; list what to compare, for example [pga_map_elites].")
    return tuple(_system(name, values) for name, values in pairs)


def _system(name: str, values: Any) -> System:
    settings = _settings(values or {}, f"system '{name}'")
    if name in RULES and settings.setdefault("algorithm", name) != name:
        raise SettingsError(
            f"system '{name}' has the algorithm '{settings['algorithm']}'; do not give it another algorithm's name."
        )
    return System(name, settings)


def _settings(given: Any, where: str) -> dict[str, Any]:
    """Return settings by name; their values are checked when a run's settings are complete."""
    if not isinstance(given, Mapping):
        raise SettingsError(f"{where} is {_kind(given)}; expected 'name: value' lines.")
    for name in given:
        if name in OF_THE_MATRIX:
            raise SettingsError(
                f"{where} gives '{name}', which comes from the key '{OF_THE_MATRIX[name]}' for all runs; remove it."
            )
    return {
        str(name): tuple(value) if isinstance(value, list) else value
        for name, value in given.items()
    }


def _several(given: Any, key: str, kind: type, example: str) -> Sequence[Any]:
    """Return the entries of a non-empty list without duplicates, all of one type."""
    if not isinstance(given, list) or not given:
        found = "missing" if given is None else "empty" if given == [] else _kind(given)
        raise SettingsError(f"{key} is {found}; give a list such as [{example}].")
    for place, value in enumerate(given):
        if type(value) is not kind:
            wanted = "a whole number" if kind is int else "a name"
            raise SettingsError(f"{key} has {value!r} in it; expected {wanted} such as {example}.")
        if value in given[:place]:
            raise SettingsError(f"{key} has {value!r} twice; name each once.")
    return given


def _kind(value: Any) -> str:
    return "missing" if value is None else f"{value!r} ({type(value).__name__})"
