"""The calls to a repertoire's services that `RepertoireClient` makes: what is asked, and how the answer is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from pga_me_msgs.srv import (
    GetActor,
    GetBehavior,
    GetBehaviors,
    GetInfo,
    ListBehaviors,
    ListGenerations,
)
from rclpy.client import Client
from rclpy.node import Node

from pga_me_ros.client.answers import (
    read_actor,
    read_behavior,
    read_behaviors,
    read_generations,
    read_list,
)
from pga_me_ros.client.behaviors import RepertoireInfo
from pga_me_ros.client.own_server import OwnServer
from pga_me_ros.client.patient_caller import PatientCaller, PendingCall
from pga_me_ros.client.requests import (
    behavior_request,
    behaviors_request,
    checked_timeout,
    generations_request,
    in_namespace,
    list_request,
)
from pga_me_ros.errors import RequestError
from pga_me_ros.ros import names, qos


class RepertoireCalls:
    """Starts calls to a repertoire.

    Args:
        node: Node that makes the calls.
        prefix: Namespace of the repertoire; empty for the node's own.
        timeout: Seconds after which a call fails that has no timeout of its own.
        server: The private archive manager that answers, None for another.
    """

    def __init__(self, node: Node, prefix: str, timeout: float, server: OwnServer | None) -> None:
        self._node = node
        self._prefix = prefix
        self._timeout = timeout
        self._server = server
        self._closed = False
        self._caller = PatientCaller(node)
        self._behavior = self._client(GetBehavior, names.GET_BEHAVIOR)
        self._behaviors = self._client(GetBehaviors, names.GET_BEHAVIORS)
        self._list = self._client(ListBehaviors, names.LIST_BEHAVIORS)
        self._generations = self._client(ListGenerations, names.LIST_GENERATIONS)
        self._info = self._client(GetInfo, names.GET_INFO)
        self._actor = self._client(GetActor, names.GET_ACTOR)

    def result(self, call: PendingCall) -> Any:
        """Wait for the result of a call, as `PatientCaller.result`."""
        return self._caller.result(call)

    def behavior(
        self, *, timeout: float | None = None, with_controller: bool = True, **wanted: Any
    ) -> PendingCall:
        """Ask for a behavior; arguments as in `RepertoireClient.get_behavior_async`."""
        request = behavior_request(**wanted, with_controller=with_controller)
        read = partial(read_behavior, with_controller=with_controller)
        return self._start(self._behavior, request, read, timeout)

    def behaviors(
        self,
        descriptor: Sequence[float],
        count: int,
        *,
        timeout: float | None = None,
        with_controllers: bool = True,
        **limits: Any,
    ) -> PendingCall:
        """Ask for the nearest behaviors; arguments as in `RepertoireClient.get_behaviors`."""
        request = behaviors_request(descriptor, count, **limits, with_controllers=with_controllers)
        read = partial(read_behaviors, with_controllers=with_controllers)
        return self._start(self._behaviors, request, read, timeout)

    def page(
        self, offset: int, most: int, timeout: float | None, limits: Mapping[str, Any]
    ) -> PendingCall:
        """Ask for a page of behaviors; arguments as in `RepertoireClient.list_behaviors_async`."""
        request = list_request(offset, most, **limits)
        return self._start(self._list, request, read_list, timeout)

    def generations(self, first: int, most: int, timeout: float | None) -> PendingCall:
        """Ask for a page of generations; arguments as in `RepertoireClient.list_generations`."""
        request = generations_request(first, most)
        return self._start(self._generations, request, read_generations, timeout)

    def info(self, timeout: float | None) -> PendingCall:
        """Ask for the description of the repertoire."""
        return self._start(self._info, GetInfo.Request(), RepertoireInfo.from_response, timeout)

    def actor(self, timeout: float | None) -> PendingCall:
        """Ask for the actor."""
        return self._start(self._actor, GetActor.Request(), read_actor, timeout)

    def close(self) -> None:
        """Destroy the service clients; only while the node is not spun."""
        self._closed = True
        self._caller.close()
        for client in (
            *(self._behavior, self._behaviors, self._list),
            *(self._generations, self._info, self._actor),
        ):
            self._node.destroy_client(client)

    def _client(self, srv_type: Any, name: str) -> Client:
        full = in_namespace(self._prefix, name)
        return self._node.create_client(
            srv_type, full, qos_profile=qos.CLIENT, callback_group=self._caller.group
        )

    def _start(
        self, client: Client, request: Any, read: Callable[[Any], Any], timeout: float | None
    ) -> PendingCall:
        self._require_answerable()
        seconds = self._timeout if timeout is None else checked_timeout(timeout)
        return self._caller.start(client, request, read, seconds, self._require_answerable)

    def _require_answerable(self) -> None:
        """Check that an answer can come.

        Raises:
            PgaError: The private archive manager has ended.
            RequestError: The client is closed.
        """
        if self._server:
            self._server.require_alive()
        if self._closed:
            raise RequestError("This client is closed; make another one.")
