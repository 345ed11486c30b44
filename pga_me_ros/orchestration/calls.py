"""Calls from the generation loop to the other nodes, with deadlines and retries, until the run is stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from pga_me_msgs.srv import (
    AddToArchive,
    Extract,
    Propose,
    SampleParents,
    StoreExperience,
    Train,
)
from rclpy.client import Client
from rclpy.node import Node

from pga_me_ros.errors import PgaError
from pga_me_ros.ros import names, qos

TICK = 0.05
"""Seconds between two checks of a condition during a wait, as not everything wakes it."""

LOOK = 0.25
"""Seconds between two looks after children, evaluators and stop requests during a wait; one takes a millisecond."""

PATIENCE = 10.0
"""Seconds after which a request is sent again, as it may have been lost."""

EAGERNESS = 0.5
"""Seconds after which a request is first sent again if its node may have been restarted: discovery takes time."""


class StoppedError(Exception):
    """The user stopped the run."""


class Waiter:
    """Lets the generation loop wait, while children are looked after.

    Args:
        look: Called every `LOOK` seconds of a wait; looks after children, and raises `StoppedError` if the run should
            end.
        arrivals: Returns how many nodes have come up so far, restarted ones included.
    """

    def __init__(self, look: Callable[[], None], arrivals: Callable[[], int] = lambda: 0) -> None:
        self._look = look
        self.arrivals = arrivals
        self._happened = threading.Event()
        self._looked = -LOOK

    def wake(self) -> None:
        """Have the condition checked again; may be called from any thread."""
        self._happened.set()

    def until(self, true: Callable[[], Any], timeout: float = float("inf")) -> bool:
        """Wait for a condition.

        Args:
            true: The condition.
            timeout: Maximum seconds to wait.

        Returns:
            Whether it came true in time.
        """
        deadline = time.monotonic() + timeout
        while True:
            self._happened.clear()
            if true():
                return True
            now = time.monotonic()
            left = deadline - now
            if left <= 0:
                return False
            if now - self._looked >= LOOK:
                self._looked = now
                self._look()
            self._happened.wait(min(TICK, left))

    def pause(self, seconds: float) -> None:
        """Wait for some time."""
        self.until(lambda: False, seconds)


def call(waiter: Waiter, client: Client, request: Any) -> Any:
    """Call a service of the graph until it answers.

    Requests to the loop's services may be repeated without harm. A request to a node that dies is never answered, so it
    is sent again as soon as a node has come up, and a few more times while discovery may lag behind. The first answer
    counts, even to an earlier request: the node may just be slow.

    Args:
        waiter: Waits for the answer.
        client: Client of the service.
        request: The request.

    Returns:
        The response, which may be a refusal.
    """
    patience = PATIENCE
    sent: list[Any] = []

    def answers() -> list[Any]:
        return [future.result() for future in sent if future.done()]

    while True:
        waiter.until(client.service_is_ready)
        arrivals = waiter.arrivals()
        sent.append(client.call_async(request))
        sent[-1].add_done_callback(lambda _: waiter.wake())
        waiter.until(lambda: answers() or arrivals != waiter.arrivals(), patience)  # noqa: B023
        if answers():
            for future in sent:
                client.remove_pending_request(future)
            return answers()[0]
        renewed = arrivals != waiter.arrivals()
        patience = EAGERNESS if renewed else min(2.0 * patience, PATIENCE)


def accepted(waiter: Waiter, client: Client, request: Any) -> Any:
    """Call a service and return its response.

    Raises:
        PgaError: The request was refused.
    """
    response = call(waiter, client, request)
    if not response.accepted:
        raise PgaError(f"{client.srv_name} refused: {response.message}")
    return response


class LoopClients:
    """One client per service.

    Args:
        node: The orchestrator's node.
    """

    def __init__(self, node: Node) -> None:
        def client(srv_type: Any, name: str) -> Client:
            return node.create_client(srv_type, name, qos_profile=qos.CLIENT)

        self.add_to_archive = client(AddToArchive, names.ADD_TO_ARCHIVE)
        self.sample_parents = client(SampleParents, names.SAMPLE_PARENTS)
        self.extract = client(Extract, names.EXTRACT)
        self.propose = client(Propose, names.PROPOSE)
        self.train = client(Train, names.TRAIN)
        self.store_experience = client(StoreExperience, names.STORE_EXPERIENCE)

    def ready(self) -> bool:
        """Whether all services have been discovered."""
        return all(client.service_is_ready() for client in vars(self).values())
