"""Reads requests to a repertoire: their limits and selection; refuses fields that would be ignored."""

from __future__ import annotations

import math

from pga_me_msgs.srv import GetBehavior, GetBehaviors, ListBehaviors

from pga_me_ros.core.archive.choosing import Demands, Judging
from pga_me_ros.errors import RequestError

NO_LIMIT = -1e308
"""A min_fitness at or below this is no limit: the default of the field."""

ANY_DISTANCE = "negative for any distance"

WAYS = {
    GetBehavior.Request.DESCRIPTOR: "descriptor",
    GetBehavior.Request.CELL: "cell",
    GetBehavior.Request.BEST: "best",
    GetBehavior.Request.RANDOM: "random",
}
"""Ways to select a behavior, by their numbers in messages."""


def demands_of(
    request: GetBehavior.Request | GetBehaviors.Request | ListBehaviors.Request,
) -> Demands:
    """Return what a request demands of behaviors.

    Raises:
        RequestError: A limit is invalid, is required but missing, or two fields contradict each other.
    """
    if math.isnan(request.min_fitness):
        raise RequestError("min_fitness is NaN; give a number, or leave it out.")
    limited = request.min_fitness > NO_LIMIT
    if request.require_fitness and not limited:
        raise RequestError("require_fitness is true, but min_fitness is not given; set it.")
    share = request.max_fall_share
    if math.isnan(share) or share > 1.0:
        raise RequestError(
            f"max_fall_share is {share}; give a share from 0 to 1, for example 0.05, or a negative number for any."
        )
    return Demands(
        Judging.of(by_mean=request.by_mean, single=request.single),
        request.min_fitness if limited else -math.inf,
        share if share >= 0.0 else math.inf,
    )


def farthest(request: GetBehavior.Request | GetBehaviors.Request) -> float:
    """Return the greatest allowed distance to the requested descriptor, infinite for no limit.

    Raises:
        RequestError: max_distance is NaN.
    """
    if math.isnan(request.max_distance):
        raise RequestError(f"max_distance is NaN; give a number, {ANY_DISTANCE}.")
    return float(request.max_distance) if request.max_distance >= 0.0 else math.inf


def require_one_way(request: GetBehavior.Request) -> str:
    """Return the way in which a request selects a behavior, after checking that it sets no field of another way.

    Raises:
        RequestError: The way is unknown, or a field is set that it does not use.
    """
    way = WAYS.get(request.select)
    if way is None:
        raise RequestError(
            f"select is {request.select}; expected 0 (descriptor), 1 (cell), 2 (best) or 3 (random)."
        )
    given = {
        "descriptor": bool(len(request.descriptor)) and way != "descriptor",
        "cell": request.cell != -1 and way != "cell",
        "max_distance": farthest(request) < math.inf and way != "descriptor",
    }
    useless = [name for name, is_given in given.items() if is_given]
    if useless:
        others = {"descriptor": "0 for the nearest to a descriptor", "cell": "1 for a cell"}
        hint = next((others[name] for name in useless if name in others), others["descriptor"])
        raise RequestError(
            f"{' and '.join(useless)} given, but select is {request.select} ({way}); leave out what is not meant, or "
            f"set select to {hint}."
        )
    return way
