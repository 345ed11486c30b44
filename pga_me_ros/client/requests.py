"""Requests to a repertoire from plain arguments, checked before they are sent."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from typing import Any

from pga_me_msgs.srv import GetBehavior, GetBehaviors, ListBehaviors

from pga_me_ros.errors import RequestError


def behavior_request(
    *,
    descriptor: Sequence[float] | None = None,
    cell: int | None = None,
    best: bool = False,
    random: bool = False,
    max_distance: float | None = None,
    min_fitness: float | None = None,
    by_mean: bool = False,
) -> GetBehavior.Request:
    """Return the request for a behavior; arguments as in `RepertoireClient.get_behavior_async`.

    Raises:
        RequestError: There is not exactly one way to choose, or a number is none.
    """
    ways = {"descriptor": descriptor is not None, "cell": cell is not None}
    ways |= {"best": best, "random": random}
    chosen = [name for name, given in ways.items() if given]
    if len(chosen) != 1:
        raise RequestError(
            f"Say in exactly one way which behavior is wanted: descriptor, cell, best or random; "
            f"given: {', '.join(chosen) or 'none'}."
        )
    request = GetBehavior.Request(select=getattr(GetBehavior.Request, chosen[0].upper()))
    request.by_mean = bool(by_mean)
    if descriptor is not None:
        request.descriptor = _numbers("descriptor", descriptor)
    if cell is not None:
        request.cell = int(cell)
    _limit_distance(request, descriptor is not None, max_distance)
    limit_fitness(request, min_fitness)
    return request


def behaviors_request(
    descriptor: Sequence[float],
    count: int,
    *,
    max_distance: float | None = None,
    min_fitness: float | None = None,
    by_mean: bool = False,
) -> GetBehaviors.Request:
    """Return the request for the nearest behaviors; arguments as in `RepertoireClient.get_behaviors`.

    Raises:
        RequestError: A number is none.
    """
    request = GetBehaviors.Request(count=int(count), by_mean=bool(by_mean), with_controllers=True)
    request.descriptor = _numbers("descriptor", descriptor)
    _limit_distance(request, True, max_distance)
    limit_fitness(request, min_fitness)
    return request


def limit_fitness(
    request: GetBehavior.Request | GetBehaviors.Request | ListBehaviors.Request,
    min_fitness: float | None,
) -> None:
    """Enter a least fitness into a request, None for any.

    Raises:
        RequestError: The value is not a number.
    """
    if min_fitness is not None:
        request.require_fitness = True
        request.min_fitness = _number("min_fitness", min_fitness)


def _limit_distance(
    request: GetBehavior.Request | GetBehaviors.Request, wanted: bool, max_distance: float | None
) -> None:
    if max_distance is not None:
        if not wanted or _number("max_distance", max_distance) < 0.0:
            raise RequestError(
                f"max_distance is {max_distance}; give 0 or more, together with a descriptor."
            )
        request.max_distance = float(max_distance)


def _numbers(name: str, values: Sequence[float]) -> array.array[float]:
    return array.array("d", [_number(name, x) for x in values])


def _number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if math.isnan(number):
        raise RequestError(f"{name} is or holds {value!r}; give a number.")
    return number
