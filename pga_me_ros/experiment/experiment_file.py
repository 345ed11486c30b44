"""Experiment files: YAML that names what is compared; every mistake is told before anything starts."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pga_me_ros.core.settings.rules import RULES
from pga_me_ros.errors import PgaError, SettingsError, nearest_name
from pga_me_ros.experiment.plan import Experiment, System

KEYS = ("systems", "tasks", "seeds", "budget", "settings", "reference")
LAYOUT = "expected the keys systems, tasks, seeds and budget; docs/experiment.md has an example"
OF_THE_MATRIX = {"task": "tasks", "seed": "seeds", "evaluations": "budget"}
"""Settings that the matrix itself decides, and the key that does."""


REFERENCE = "pga_map_elites"
"""What the others are compared with unless the file names another: p-values are against it (section 4.4)."""


class _Loader(yaml.SafeLoader):
    """Refuses a key that is given twice, of which YAML would silently take the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for place, key in enumerate(keys):
            if key in keys[:place]:
                mark = node.value[place][0].start_mark
                raise yaml.constructor.ConstructorError(
                    problem=f"'{key}' is given twice", problem_mark=mark
                )
        return super().construct_mapping(node, deep)


def read_experiment(path: Path) -> Experiment:
    """Read an experiment file and check all of it.

    Args:
        path: The file.

    Raises:
        SettingsError: The file is missing, no YAML, or asks for what makes no sense.
    """
    content = _loaded(path)
    try:
        return _experiment(content)
    except PgaError as error:
        raise SettingsError(f"Experiment file '{path}': {error}") from None


def _loaded(path: Path) -> Any:
    try:
        return yaml.load(path.read_text(), _Loader)
    except FileNotFoundError:
        near = nearest_name(path.name, [p.name for p in path.parent.glob("*.yaml")])
        raise SettingsError(
            f"There is no experiment file '{path}'{near}; give the path of a YAML file."
        ) from None
    except OSError as error:
        raise SettingsError(
            f"Experiment file '{path}' cannot be read ({error.strerror}); give the path of a YAML file."
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError, TypeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        raise SettingsError(
            f"Experiment file '{path}' is no valid YAML{where}: {problem}; {LAYOUT}."
        ) from None


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
        budget = int(budget)  # 1e6 is how people write a million
    if type(budget) is not int:
        raise SettingsError(
            f"budget is {_kind(budget)}; give the evaluations of each run, for example 20000."
        )
    names = [system.name for system in systems]
    reference = content.get("reference", REFERENCE if REFERENCE in names else names[0])
    if reference not in names:
        raise SettingsError(
            f"reference is {reference!r}{nearest_name(str(reference), names)}; name one of the systems, with which "
            f"the others are compared: {', '.join(names)}."
        )
    experiment = Experiment(systems, tuple(tasks), tuple(seeds), budget, settings, reference)
    experiment.check()
    return experiment


def _systems(given: Any) -> tuple[System, ...]:
    """Return the systems: names of algorithms, or names with the settings that make the difference.

    A system that is called like an algorithm is that algorithm.
    """
    if isinstance(given, Mapping):
        pairs = list(given.items())
    else:
        names = _several(given, "systems", str, "pga_map_elites")
        pairs = [(name, {"algorithm": name}) for name in names]
    if not pairs:
        raise SettingsError(
            "systems names none; name what is to be compared, for example [pga_map_elites]."
        )
    return tuple(_system(name, values) for name, values in pairs)


def _system(name: str, values: Any) -> System:
    settings = _settings(values or {}, f"system '{name}'")
    if name in RULES and settings.setdefault("algorithm", name) != name:
        raise SettingsError(
            f"system '{name}' has the algorithm '{settings['algorithm']}'; give it a name that is no other algorithm's."
        )
    return System(name, settings)


def _settings(given: Any, where: str) -> dict[str, Any]:
    """Return settings by name; their values are checked when a run's settings are complete."""
    if not isinstance(given, Mapping):
        raise SettingsError(f"{where} is {_kind(given)}; expected 'name: value' lines.")
    for name in given:
        if name in OF_THE_MATRIX:
            raise SettingsError(
                f"{where} gives '{name}', which all runs have from the key '{OF_THE_MATRIX[name]}'; leave it out there."
            )
    return {
        str(name): tuple(value) if isinstance(value, list) else value
        for name, value in given.items()
    }


def _several(given: Any, key: str, kind: type, example: str) -> Sequence[Any]:
    """Return the entries of a list that has some, all of one type and none twice."""
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
