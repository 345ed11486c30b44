"""The settings of a run: the one source of names, defaults, ranges, units and documentation.

ROS parameter descriptors, the validation of YAML files and the tables in the docs are derived from `Settings`.
Defaults are Table 1 of Nilsson & Cully (2021); where the authors' code departs from the paper, a setting chooses and
its description names both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from pga_me_ros.core.settings.algorithms import AlgorithmSettings
from pga_me_ros.core.settings.field import checked_value
from pga_me_ros.core.settings.rules import RULES, of_other_archives, useless
from pga_me_ros.errors import SettingsError, nearest_name


@dataclass(frozen=True)
class Settings(AlgorithmSettings):
    """Everything that decides which repertoire a run ends with.

    A default that stands for the algorithm's own value (0, -1 or an empty string) is replaced by that value. A value
    that was given counts, or is refused: a setting that the algorithm or archive has no use for must keep its default.
    """

    def __post_init__(self) -> None:
        """Check every value, and put in the algorithm's own ones.

        Raises:
            SettingsError: A value has the wrong type, is out of its range, does not fit another one, or is of no use.
        """
        for f in fields(self):
            object.__setattr__(self, f.name, checked_value(f, getattr(self, f.name)))
        rules = RULES[self.algorithm]
        given = {f.name: v for f in fields(self) if (v := getattr(self, f.name)) != f.default}
        object.__setattr__(self, "_given", given)
        for name, value in rules.own_values(given).items():
            if name not in given:
                object.__setattr__(self, name, value)
            elif not rules.uses(name) and given[name] != value:
                raise self._useless(name)
        unused = useless(given, self.algorithm, self.archive)
        for name in given:
            if name in unused and not _OWN[name]:
                raise self._useless(name)
        rules.check(self)

    def _useless(self, name: str) -> SettingsError:
        """Return the error for a value that would change nothing."""
        reason = RULES[self.algorithm].fixed.get(name, "doesn't use it")
        who = self.algorithm
        if name in of_other_archives(self.archive):
            who = f"a {self.archive} archive"
        return SettingsError(f"{name} is {self.given[name]!r}, but {who} {reason}; remove {name}.")

    @property
    def given(self) -> dict[str, Any]:
        """The values that differ from the defaults, by name: what makes equal settings."""
        return dict(self.__dict__["_given"])

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Make settings from names and values, defaults for the rest.

        Raises:
            SettingsError: A name is unknown, or a value has the wrong type or is out of its range.
        """
        known = [f.name for f in fields(cls)]
        for name in values:
            if name not in known:
                raise SettingsError(
                    f"Unknown setting '{name}'{nearest_name(name, known)}; "
                    "docs/parameters.md lists all."
                )
        return cls(**values)

    @classmethod
    def from_stored(cls, values: Mapping[str, Any]) -> Settings:
        """Make the settings that a run was made with, by this version or an older one, from what `to_dict` returned.

        All of them are named there, those too that the algorithm or archive has no use for: these are left out.

        Raises:
            SettingsError: As in `from_mapping`.
        """
        archive = values.get("archive", cls.archive)
        unused = useless(values, values.get("algorithm", ""), archive)
        used = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
            if name not in unused
        }
        return cls.from_mapping(used)

    def to_dict(self) -> dict[str, Any]:
        """Return names and values, tuples as lists, fit for JSON."""
        return {
            k: list(v) if isinstance(v, tuple) else v for k, v in dataclasses.asdict(self).items()
        }

    def replace(self, **changes: Any) -> Settings:
        """Return a copy with some values changed and checked; the algorithm's own values follow the change."""
        return Settings.from_mapping({**self.given, **changes})

    def with_rates(self, rates: Mapping[str, Any]) -> Settings:
        """Return a copy with the rates of a generation, as they are stored or travel: all of them, used or not.

        Raises:
            SettingsError: A rate is out of its range, or stands for the algorithm's own value.
        """
        rules = RULES[self.algorithm]
        for f in fields(self):
            if f.metadata["own"] and f.name in rates and rates[f.name] == f.default:
                raise SettingsError(
                    f"{f.name} is {f.default}, which stands for the algorithm's own value; the rates of a generation "
                    "name the value itself."
                )
        return self.replace(**{name: value for name, value in rates.items() if rules.uses(name)})

    @property
    def rates(self) -> dict[str, Any]:
        """The settings that may change while a run is under way, by name."""
        return {name: getattr(self, name) for name in RATES}

    @property
    def init_generations(self) -> int:
        """Number of generations of random controllers: ceil(G / b)."""
        return math.ceil(self.random_init / self.batch_size)

    @property
    def generations(self) -> int:
        """Number of generations that reach the budget: ceil(I / b)."""
        return math.ceil(self.evaluations / self.batch_size)


RATES = tuple(f.name for f in fields(Settings) if f.metadata["rate"])
"""Names of the settings that may change while a run is under way."""

_OWN = {f.name: f.metadata["own"] for f in fields(Settings)}


def identity_difference(ours: Settings, theirs: Settings) -> list[str]:
    """Name the settings in which two runs differ, other than rates and the budget.

    Returns:
        One ``"name: ours != theirs"`` per difference, empty when one may resume the other.
    """
    out = []
    for f in fields(Settings):
        if f.metadata["identity"] and not f.metadata["rate"]:
            a, b = getattr(ours, f.name), getattr(theirs, f.name)
            if a != b:
                out.append(f"{f.name}: {a} != {b}")
    return out
