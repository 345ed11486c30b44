"""The client for robot nodes: ask a repertoire for behaviors, and run them. Needs only rclpy and NumPy.

::

    repertoire = RepertoireClient(node)
    behavior = repertoire.get_behavior(descriptor=[0.9, 0.1], min_fitness=500.0)
    action = behavior.controller(observation)  # every behavior.controller.control_period seconds
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

from pga_me_ros.client.actor import Actor
from pga_me_ros.client.behaviors import (
    Behavior,
    FoundBehavior,
    ListedBehavior,
    RepertoireInfo,
)
from pga_me_ros.client.generations import ListedGeneration
from pga_me_ros.client.own_server import OwnServer
from pga_me_ros.client.repertoire_calls import RepertoireCalls
from pga_me_ros.client.requests import checked_timeout
from pga_me_ros.errors import RequestError

TIMEOUT = 10.0
"""Seconds; discovery between processes takes up to 4."""

PAGE = 500
"""Behaviors per answer while listing."""

GENERATIONS_PAGE = 200
"""Generations per answer while listing: few enough that a run never waits for its archive manager."""


class RepertoireClient:
    """Asks a repertoire for behaviors.

    The plain methods block and raise. They work in a program that does not spin its node (they spin it themselves, and
    so run its other callbacks), and in any thread while another thread spins the node. Inside a callback use the
    methods that end in ``_async``: they return a future at once, to await or to add a callback to.

    Args:
        node: Node that makes the calls.
        prefix: Namespace of the repertoire, such as ``/left``; empty for the node's own.
        timeout: Seconds after which a call fails, waiting for the service included.
        repertoire: Repertoire to serve by a private archive manager, until `close` or the end of this process:
            ``zoo/NAME``, the folder of a run, or a repertoire file. Empty to use a repertoire that is already served.

    Raises:
        RequestError: The timeout is invalid, or both a prefix and a repertoire are given.
        SettingsError: The prefix is no valid namespace.
        StorageError: There is no such repertoire.
    """

    def __init__(
        self,
        node: Node,
        prefix: str = "",
        timeout: float = TIMEOUT,
        *,
        repertoire: str | Path = "",
    ) -> None:
        timeout = checked_timeout(timeout)
        if repertoire and prefix:
            raise RequestError(
                f"prefix is '{prefix}', but the repertoire that the client serves has its own namespace; give only one."
            )
        self._server = OwnServer(node, repertoire) if repertoire else None
        prefix = self._server.prefix if self._server else prefix
        self._node = node
        self._calls = RepertoireCalls(node, prefix, timeout, self._server)

    def get_behavior(self, **wanted: Any) -> Behavior:
        """Return a behavior with its controller.

        Args:
            wanted: As in `get_behavior_async`.

        Raises:
            BehaviorNotFoundError: No behavior matches.
            RepertoireTimeoutError: No response before the deadline.
            BlockedExecutorError: Called in a callback of the node's executor. With rclpy's events executor this cannot
                be detected; the call then ends at its deadline.
            RequestError: The arguments are invalid.
            NetworkError: The response's controller is malformed.
        """
        return self._calls.result(self._calls.behavior(**wanted))

    def get_behavior_async(
        self,
        *,
        descriptor: Sequence[float] | None = None,
        cell: int | None = None,
        best: bool = False,
        random: bool = False,
        max_distance: float | None = None,
        min_fitness: float | None = None,
        max_fall_share: float | None = None,
        by_mean: bool = False,
        single: bool = False,
        timeout: float | None = None,
    ) -> Future:
        """Ask for a behavior, chosen in one of four ways.

        Behaviors with re-evaluations are judged by their means, the others by their single evaluation;
        `Behavior.by_mean` tells which was used.

        Args:
            descriptor: d numbers; the behavior with the nearest descriptor.
            cell: Number of a cell; the behavior in it.
            best: The fittest behavior.
            random: A behavior drawn uniformly.
            max_distance: Greatest Euclidean distance to the wanted descriptor, each dimension in shares of its range
                (high - low); None for any.
            min_fitness: Least fitness, None for any.
            max_fall_share: Greatest share of its re-evaluations that ended in a fall, 0 to 1; None for any. Behaviors
                without re-evaluations never meet this limit.
            by_mean: Whether to leave out behaviors without re-evaluations.
            single: Whether to judge all behaviors by their single evaluation.
            timeout: Seconds after which the call fails, None for the client's default.

        Returns:
            Future of a `Behavior`; its result() raises what `get_behavior` raises.

        Raises:
            RequestError: The arguments are invalid.
        """
        call = self._calls.behavior(
            descriptor=descriptor,
            cell=cell,
            best=best,
            random=random,
            max_distance=max_distance,
            min_fitness=min_fitness,
            max_fall_share=max_fall_share,
            by_mean=by_mean,
            single=single,
            timeout=timeout,
        )
        return call.future

    def find_behavior(self, **wanted: Any) -> FoundBehavior:
        """Return a behavior without its controller: a small response, for example for a table.

        Args:
            wanted: As in `get_behavior_async`.

        Raises:
            PgaError: As in `get_behavior`.
        """
        found: FoundBehavior = self._calls.result(
            self._calls.behavior(**wanted, with_controller=False)
        )
        return found

    def find_behaviors(
        self, descriptor: Sequence[float], count: int, **limits: Any
    ) -> tuple[FoundBehavior, ...]:
        """Return the behaviors with the nearest descriptors, nearest first, without their controllers.

        Args:
            descriptor: d numbers.
            count: Most behaviors to return, 1 to 1000.
            limits: As in `get_behaviors`.

        Raises:
            PgaError: As in `get_behaviors`.
        """
        found: tuple[FoundBehavior, ...] = self._calls.result(
            self._calls.behaviors(descriptor, count, **limits, with_controllers=False)
        )
        return found

    def get_behaviors(
        self, descriptor: Sequence[float], count: int, **limits: Any
    ) -> tuple[Behavior, ...]:
        """Return the behaviors with the nearest descriptors, nearest first, each with its controller.

        Args:
            descriptor: d numbers.
            count: Most behaviors to return, 1 to 1000.
            limits: max_distance, min_fitness, max_fall_share, by_mean, single and timeout as in `get_behavior_async`.

        Raises:
            RequestError: The arguments are invalid, or the repertoire refuses them.
            RepertoireTimeoutError: As in `get_behavior`.
            BlockedExecutorError: As in `get_behavior`.
            NetworkError: A controller in the response is malformed.

        Returns:
            At most `count` behaviors that match, possibly none.
        """
        return self._calls.result(self._calls.behaviors(descriptor, count, **limits))

    def get_behaviors_async(self, descriptor: Sequence[float], count: int, **limits: Any) -> Future:
        """Ask for the nearest behaviors; returns a future of the result of `get_behaviors`."""
        return self._calls.behaviors(descriptor, count, **limits).future

    def list_behaviors(
        self, *, page: int = PAGE, timeout: float | None = None, **limits: Any
    ) -> Iterator[ListedBehavior]:
        """Yield all behaviors without their controllers, fittest first.

        Requests one page at a time, on demand. Each cell is yielded at most once, even if a run adds behaviors
        meanwhile.

        Args:
            page: Behaviors per response, 1 to 10,000.
            timeout: Seconds after which the call for a page fails, None for the client's default.
            limits: min_fitness, max_fall_share, by_mean and single as in `get_behavior_async`.

        Raises:
            RequestError: The arguments are invalid, or the repertoire refuses them.
            RepertoireTimeoutError: As in `get_behavior`.
            BlockedExecutorError: As in `get_behavior`.
        """
        seen: set[int] = set()
        offset = 0
        while True:
            call = self._calls.page(offset, page, timeout, limits)
            total, behaviors = self._calls.result(call)
            for behavior in behaviors:
                if behavior.cell not in seen:
                    seen.add(behavior.cell)
                    yield behavior
            offset += page
            if offset >= total:
                return

    def list_behaviors_async(
        self, offset: int = 0, limit: int = PAGE, *, timeout: float | None = None, **limits: Any
    ) -> Future:
        """Ask for one page of behaviors, fittest first.

        Args:
            offset: Number of behaviors to skip.
            limit: Most behaviors to return, 1 to 10,000.
            timeout: Seconds after which the call fails, None for the client's default.
            limits: As in `list_behaviors`.

        Returns:
            Future of the number of behaviors that match, and the page as a tuple of `ListedBehavior`.
        """
        return self._calls.page(offset, limit, timeout, limits).future

    def list_generations(
        self, first: int = 0, *, page: int = GENERATIONS_PAGE, timeout: float | None = None
    ) -> Iterator[ListedGeneration]:
        """Yield what the run had achieved after each of its generations, the earliest first.

        Requests one page at a time, on demand.

        Args:
            first: Number of the first generation.
            page: Generations per response, 1 to 1000.
            timeout: Seconds after which the call for a page fails, None for the client's default.

        Raises:
            RequestError: The arguments are invalid, or the repertoire refuses them.
            RepertoireTimeoutError: As in `get_behavior`.
            BlockedExecutorError: As in `get_behavior`.
        """
        while True:
            total, generations = self._calls.result(self._calls.generations(first, page, timeout))
            yield from generations
            first += page
            if first >= total:
                return

    def get_info(self, *, timeout: float | None = None) -> RepertoireInfo:
        """Return the description of the repertoire and its progress.

        Raises:
            RepertoireTimeoutError: As in `get_behavior`.
            BlockedExecutorError: As in `get_behavior`.
        """
        return self._calls.result(self._calls.info(timeout))

    def get_info_async(self, *, timeout: float | None = None) -> Future:
        """Ask for the description of the repertoire; returns a future of a `RepertoireInfo`."""
        return self._calls.info(timeout).future

    def get_actor(self, *, timeout: float | None = None) -> Actor:
        """Return the actor of a repertoire of DCRL-MAP-Elites: one network that is told at every step what is wanted.

        While a run goes on, it is the one whose training ended last.

        Raises:
            ActorNotFoundError: There is none: the algorithm learns no actor, or no training has ended yet.
            RepertoireTimeoutError: As in `get_behavior`.
            BlockedExecutorError: As in `get_behavior`.
            NetworkError: The response is malformed.
        """
        return self._calls.result(self._calls.actor(timeout))

    def get_actor_async(self, *, timeout: float | None = None) -> Future:
        """Ask for the actor; returns a future of the result of `get_actor`."""
        return self._calls.actor(timeout).future

    def close(self) -> None:
        """Destroy the service clients and end the private archive manager; call it only while the node is not spun."""
        self._calls.close()
        if self._server:
            self._server.close()
