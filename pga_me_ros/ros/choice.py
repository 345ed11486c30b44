"""Which behavior of a repertoire a node takes: parameters that several nodes share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pga_me_ros.core.settings.field import INT64_MAX, setting
from pga_me_ros.errors import SettingsError


@dataclass(frozen=True)
class ChoiceSettings:
    """Which behavior is wanted, and what it must promise."""

    select: str = setting(
        "auto",
        "Gait to take: the one nearest to 'descriptor', the one in 'cell', the 'best', or a 'random' one, in the "
        "player another in each episode; 'auto' uses descriptor or cell, whichever is given, else the best.",
        choices=("auto", "descriptor", "cell", "best", "random"),
    )
    descriptor: tuple[float, ...] = setting(
        (), "Wanted descriptor, one number per dimension, each with a decimal point: [0.9, 0.1]."
    )
    cell: int = setting(-1, "Wanted cell of the archive; -1 for none.", low=-1, high=INT64_MAX)
    min_fitness: float = setting(-math.inf, "Least fitness of a gait that may be chosen.")
    max_fall_share: float = setting(
        math.inf,
        "Greatest share of a gait's re-evaluations that may have ended in a fall, 0 to 1; infinite for any.",
        low=0.0,
        high=math.inf,
    )
    single: bool = setting(
        False,
        "Whether gaits are chosen by their original, single evaluation instead of the means of their re-evaluations.",
    )


def wanted(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the choice of a gait as arguments of `RepertoireClient.get_behavior`.

    Args:
        values: Parameters by name.

    Raises:
        SettingsError: The parameters contradict each other.
    """
    descriptor, cell, select = values["descriptor"], values["cell"], values["select"]
    given = [
        name for name, is_given in (("descriptor", descriptor), ("cell", cell >= 0)) if is_given
    ]
    if select == "auto":
        select = given[0] if given else "best"
    if any(name != select for name in given):
        raise SettingsError(
            f"{' and '.join(given)} given, but the gait is chosen by {select}; leave out what is not meant."
        )
    if select in ("descriptor", "cell") and select not in given:
        raise SettingsError(f"select is '{select}', but no {select} is given: -p {select}:=...")
    choice: dict[str, Any] = {
        "descriptor": {"descriptor": list(descriptor)},
        "cell": {"cell": cell},
        "best": {"best": True},
        "random": {"random": True},
    }[select]
    if values["min_fitness"] > -math.inf:
        choice["min_fitness"] = values["min_fitness"]
    if values["max_fall_share"] < math.inf:
        choice["max_fall_share"] = values["max_fall_share"]
    if values["single"]:
        choice["single"] = True
    return choice
