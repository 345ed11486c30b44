"""Builds requests to a repertoire from plain arguments, which are checked before they are sent."""

from __future__ import annotations

import array
from collections.abc import Sequence
from typing import Any

from pga_me_msgs.srv import GetBehavior, GetBehaviors, ListBehaviors, ListGenerations

from pga_me_ros.arguments import number, numbers, share, whole_number
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.node_names import require_valid_namespace

LEAST_FITNESS = -9.9e307
"""Least value of min_fitness that is sent; the field's default, -1e308, means no limit."""


def behavior_request(
    *,
    descriptor: Sequence[float] | None = None,
    cell: int | None = None,
    best: bool = False,
    random: bool = False,
    max_distance: float | None = None,
    with_controller: bool = True,
    **limits: Any,
) -> GetBehavior.Request:
    """Return the request for a behavior; arguments as in `RepertoireClient.get_behavior_async`.

    Raises:
        RequestError: Not exactly one way to choose is given, or an argument is not a number.
    """
    ways = {"descriptor": descriptor is not None, "cell": cell is not None}
    ways |= {"best": best, "random": random}
    chosen = [name for name, given in ways.items() if given]
    if len(chosen) != 1:
        raise RequestError(
            f"Give exactly one of descriptor, cell, best and random to choose a behavior; "
            f"given: {', '.join(chosen) or 'none'}."
        )
    request = GetBehavior.Request(select=getattr(GetBehavior.Request, chosen[0].upper()))
    request.with_controller = bool(with_controller)
    if descriptor is not None:
        request.descriptor = array.array("d", numbers("descriptor", descriptor))
    if cell is not None:
        request.cell = whole_number("cell", cell)
    _limit_distance(request, descriptor is not None, max_distance)
    limit(request, **limits)
    return request


def behaviors_request(
    descriptor: Sequence[float],
    count: int,
    *,
    max_distance: float | None = None,
    with_controllers: bool = True,
    **limits: Any,
) -> GetBehaviors.Request:
    """Return the request for the nearest behaviors; arguments as in `RepertoireClient.get_behaviors`.

    Raises:
        RequestError: An argument is not a number.
    """
    request = GetBehaviors.Request(
        count=whole_number("count", count), with_controllers=bool(with_controllers)
    )
    request.descriptor = array.array("d", numbers("descriptor", descriptor))
    _limit_distance(request, True, max_distance)
    limit(request, **limits)
    return request


def list_request(offset: int, most: int, **limits: Any) -> ListBehaviors.Request:
    """Return the request for a page of behaviors; arguments as in `RepertoireClient.list_behaviors_async`.

    Raises:
        RequestError: An argument is not a number.
    """
    request = ListBehaviors.Request(
        offset=whole_number("offset", offset), limit=whole_number("limit", most)
    )
    limit(request, **limits)
    return request


def generations_request(first: int, most: int) -> ListGenerations.Request:
    """Return the request for a page of generations; arguments as in `RepertoireClient.list_generations`.

    Raises:
        RequestError: An argument is not a number.
    """
    return ListGenerations.Request(
        first=whole_number("first", first), limit=whole_number("page", most)
    )


def limit(
    request: GetBehavior.Request | GetBehaviors.Request | ListBehaviors.Request,
    *,
    min_fitness: float | None = None,
    max_fall_share: float | None = None,
    by_mean: bool = False,
    single: bool = False,
) -> None:
    """Set the limits of a request, and how it judges behaviors, as in `RepertoireClient.get_behavior_async`.

    Raises:
        RequestError: A value is not a number, or two arguments contradict each other.
    """
    if by_mean and single:
        raise RequestError("by_mean and single contradict each other; give at most one of them.")
    request.by_mean, request.single = bool(by_mean), bool(single)
    if min_fitness is not None:
        # Raised to a bound far below any fitness, so that it is never mistaken for the field's default, no limit.
        request.min_fitness = max(number("min_fitness", min_fitness), LEAST_FITNESS)
    if max_fall_share is not None:
        request.max_fall_share = share("max_fall_share", max_fall_share)


def _limit_distance(
    request: GetBehavior.Request | GetBehaviors.Request, wanted: bool, max_distance: float | None
) -> None:
    if max_distance is not None:
        if not wanted or number("max_distance", max_distance) < 0.0:
            raise RequestError(
                f"max_distance is {max_distance}; give 0 or more, together with a descriptor."
            )
        request.max_distance = float(max_distance)


def checked_timeout(seconds: float) -> float:
    """Return a timeout as a float.

    Raises:
        RequestError: The timeout is not a number above 0.
    """
    found = number("timeout", seconds)
    if found <= 0.0:
        raise RequestError(f"timeout is {seconds}; give seconds above 0.")
    return found


def in_namespace(prefix: str, name: str) -> str:
    """Return the name of a service in a namespace.

    Args:
        prefix: The namespace; empty, or without a slash at its beginning, for one in that of the node.
        name: Relative name of the service.

    Raises:
        SettingsError: ROS 2 does not allow the namespace.
    """
    place = prefix.rstrip("/")
    absolute = f"/{place.removeprefix('~').removeprefix('/')}"
    require_valid_namespace(absolute, "prefix=")
    return f"{place}/{name}" if prefix else name
