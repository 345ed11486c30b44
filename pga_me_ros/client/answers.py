"""Turns the responses of a repertoire into values, or raises the error that they report."""

from __future__ import annotations

from pga_me_msgs.srv import GetActor, GetBehavior, GetBehaviors, ListBehaviors, ListGenerations

from pga_me_ros.client.actor import Actor
from pga_me_ros.client.behaviors import Behavior, FoundBehavior, ListedBehavior
from pga_me_ros.client.generations import ListedGeneration
from pga_me_ros.errors import PgaError, RequestError


class BehaviorNotFoundError(PgaError):
    """No behavior fits, or the request does not fit the repertoire; the message says why."""


class ActorNotFoundError(PgaError):
    """The repertoire has no actor; the message says why."""


def read_behavior(response: GetBehavior.Response, *, with_controller: bool) -> FoundBehavior:
    """Return the behavior in a response.

    Raises:
        BehaviorNotFoundError: The response has no behavior.
        NetworkError: Its controller is malformed.
    """
    if not response.found:
        raise BehaviorNotFoundError(response.message)
    if not with_controller:
        return FoundBehavior.found(response)
    return Behavior.from_response(response)


def read_behaviors(
    response: GetBehaviors.Response, *, with_controllers: bool
) -> tuple[FoundBehavior, ...]:
    """Return the behaviors in a response.

    Raises:
        RequestError: The request was refused.
        NetworkError: The response is malformed.
    """
    if not response.ok:
        raise RequestError(response.message)
    if not with_controllers:
        return FoundBehavior.all_found(response)
    return Behavior.all_from_response(response)


def read_list(response: ListBehaviors.Response) -> tuple[int, tuple[ListedBehavior, ...]]:
    """Return the number of behaviors that match, and the page in a response.

    Raises:
        RequestError: The request was refused.
    """
    if not response.ok:
        raise RequestError(response.message)
    return response.total, tuple(ListedBehavior.from_msg(msg) for msg in response.behaviors)


def read_actor(response: GetActor.Response) -> Actor:
    """Return the actor in a response.

    Raises:
        ActorNotFoundError: The response has none.
        NetworkError: It is malformed.
    """
    if not response.found:
        raise ActorNotFoundError(response.message)
    return Actor.from_response(response)


def read_generations(
    response: ListGenerations.Response,
) -> tuple[int, tuple[ListedGeneration, ...]]:
    """Return the number of generations of the run, and the page in a response.

    Raises:
        RequestError: The request was refused.
        NetworkError: The response is malformed.
    """
    if not response.ok:
        raise RequestError(response.message)
    return response.total, ListedGeneration.from_response(response)
