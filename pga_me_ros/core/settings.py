"""The settings of a run: the one source of names, defaults, ranges, units and documentation.

ROS parameter descriptors, the validation of YAML files and the table in the docs are derived from `Settings`.
Defaults are Table 1 of Nilsson & Cully (2021); where the authors' code departs from the paper, a setting chooses and
its description names both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from pga_me_ros.core.errors import SettingsError, nearest_name
from pga_me_ros.core.setting_field import checked_value
from pga_me_ros.core.system_settings import SystemSettings
from pga_me_ros.core.systems import SYSTEMS


@dataclass(frozen=True)
class Settings(SystemSettings):
    """Everything that decides which repertoire a run ends with.

    A system of section 4.2 may have defaults of its own: they take the place of the value that everybody else has by
    default, so that the name of the system is all that a command has to give.
    """

    def __post_init__(self) -> None:
        """Check every value, and put in the system's own defaults.

        Raises:
            SettingsError: A value has the wrong type, is out of its range, or does not fit the system.
        """
        for f in fields(self):
            object.__setattr__(self, f.name, checked_value(f, getattr(self, f.name)))
        system = SYSTEMS[self.algorithm]
        given = {f.name: v for f in fields(self) if (v := getattr(self, f.name)) != f.default}
        for name, value in system.defaults.items():
            object.__setattr__(self, name, given.get(name, value))
        system.check(self, given)

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

    def to_dict(self) -> dict[str, Any]:
        """Return names and values, tuples as lists, fit for JSON."""
        return {
            k: list(v) if isinstance(v, tuple) else v for k, v in dataclasses.asdict(self).items()
        }

    def replace(self, **changes: Any) -> Settings:
        """Return a copy with some values changed and checked."""
        return dataclasses.replace(self, **changes)

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
