"""Calls from the generation loop to the other nodes: deadlines, repeats, and an end when the run is stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.client import Client

from pga_me_ros.core.errors import PgaError

TICK = 0.05
"""Seconds between two looks at children and stop requests while something is waited for."""

PATIENCE = 10.0
"""Seconds after which a request is sent again: a node that was restarted never saw the first one."""


class StoppedError(Exception):
    """The run was asked to stop."""


class Waiter:
    """Lets the generation loop wait without missing what happens meanwhile.

    Args:
        look: Called at every tick; looks after children and raises `StoppedError` when the run is to end.
    """

    def __init__(self, look: Callable[[], None]) -> None:
        self._look = look
        self._happened = threading.Event()

    def wake(self) -> None:
        """Say, from any thread, that something may have come true."""
        self._happened.set()

    def until(self, true: Callable[[], bool], timeout: float = float("inf")) -> bool:
        """Wait for a condition.

        Args:
            true: The condition.
            timeout: Seconds to wait at most.

        Returns:
            Whether it came true in time.
        """
        deadline = time.monotonic() + timeout
        while True:
            self._happened.clear()
            if true():
                return True
            left = deadline - time.monotonic()
            if left <= 0:
                return False
            self._look()
            self._happened.wait(min(TICK, left))


def call(waiter: Waiter, client: Client, request: Any) -> Any:
    """Call a service of the graph until it answers.

    Every service of the loop may be asked the same thing twice without harm.

    Args:
        waiter: How to wait.
        client: Client of the service.
        request: The request.

    Returns:
        The response, which may be a refusal.
    """
    while True:
        waiter.until(client.service_is_ready)
        future = client.call_async(request)
        future.add_done_callback(lambda _: waiter.wake())
        if waiter.until(future.done, PATIENCE):
            return future.result()
        client.remove_pending_request(future)


def accepted(waiter: Waiter, client: Client, request: Any) -> Any:
    """Call a service and return its response.

    Raises:
        PgaError: The request was refused.
    """
    response = call(waiter, client, request)
    if not response.accepted:
        raise PgaError(f"{client.srv_name} refused: {response.message}")
    return response
