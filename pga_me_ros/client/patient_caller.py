"""Service calls that wait for the service, end by a deadline, and never deadlock."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Any, TypeVar

from rclpy import executors
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from pga_me_ros.errors import PgaError
from pga_me_ros.ros.dds_choices import other_users_note

TICK = 0.05
"""Seconds between two checks of the service and the deadline."""

SPIN_GRACE = 0.5
"""Seconds past the deadline that the node's executor gets to report it, before we assume that it is not spinning."""

Result = TypeVar("Result")


class RepertoireTimeoutError(PgaError):
    """The service was not available, or did not respond, before the deadline."""


class BlockedExecutorError(PgaError):
    """A blocking call was made in a callback, where waiting would block its own response."""


class PendingCall:
    """A pending service call.

    Args:
        node: Node that calls.
        client: Client of the service.
        request: The request.
        read: Turns the response into the result, or raises.
        timeout: Seconds until the call fails.
        servers: Which nodes offer the service, in words.
        check: Raises a `PgaError` once the service cannot come or answer any more; the call then ends with it.
    """

    def __init__(
        self,
        node: Node,
        client: Client,
        request: Any,
        read: Callable[[Any], Any],
        timeout: float,
        servers: str,
        check: Callable[[], None],
    ) -> None:
        self._servers = servers
        self.future = Future(executor=node.executor)
        self._name = node.resolve_service_name(client.srv_name)
        self.ended = threading.Event()
        self._ending = False
        self.deadline = time.monotonic() + timeout
        self._client = client
        self._request = request
        self._read = read
        self._check = check
        self._timeout = timeout
        self._answer: Future | None = None
        self._lock = threading.Lock()

    def advance(self) -> bool:
        """Send the request once the service is available; fail after the deadline.

        Returns:
            Whether the call has ended.
        """
        with self._lock:
            if self._answer is None and not self._ending and self._client.service_is_ready():
                self._answer = self._client.call_async(self._request)
                self._answer.add_done_callback(self._answered)
        if self.future.cancelled():
            self._end(lambda: None)
        elif time.monotonic() >= self.deadline:
            self.fail(self._reason())
        try:
            self._check()
        except PgaError as error:
            self._end(partial(self.future.set_exception, error))
        return self.ended.is_set()

    def fail(self, reason: str) -> None:
        """End the call with an error, unless it has already ended."""
        self._end(lambda: self.future.set_exception(RepertoireTimeoutError(reason)))

    def _answered(self, answer: Future) -> None:
        try:
            result = self._read(answer.result())
        except Exception as error:
            self._end(partial(self.future.set_exception, error))
        else:
            self._end(lambda: self.future.set_result(result))

    def _end(self, settle: Callable[[], None]) -> None:
        with self._lock:
            if self._ending:
                return
            self._ending = True
        if self._answer is not None:
            self._client.remove_pending_request(self._answer)
        if not self.future.cancelled():
            settle()
        self.ended.set()  # last: waiting threads read the future at once

    def _reason(self) -> str:
        name = self._name
        if self._answer is None:
            return (
                f"Service {name} was not available within {self._timeout:g} s; start {self._servers}, "
                f"and check ROS_DOMAIN_ID, namespace and remappings.{other_users_note()}"
            )
        return (
            f"Service {name} did not respond within {self._timeout:g} s; its node may be busy or have "
            f"just died. Try again, or give a longer timeout.{other_users_note()}"
        )


class PatientCaller:
    """Makes service calls for one node.

    It never spins a node that an executor already spins; otherwise it spins the node itself while a call blocks.

    Args:
        node: The node.
        servers: Which nodes offer the services that are called, in words.
    """

    def __init__(self, node: Node, servers: str = "the orchestrator or an archive_manager") -> None:
        self._node, self._servers = node, servers
        # Lets a MultiThreadedExecutor handle the response while another callback of the node waits for it.
        self.group = ReentrantCallbackGroup()
        self._lock = threading.Lock()
        self._spinning = threading.Lock()
        self._pending: list[PendingCall] = []
        # Wall clocks may jump, and simulated clocks may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(TICK, self._tick, self.group, steady, autostart=False)

    def start(
        self,
        client: Client,
        request: Any,
        read: Callable[[Any], Result],
        timeout: float,
        check: Callable[[], None] = lambda: None,
    ) -> PendingCall:
        """Start a call, with arguments as those of `PendingCall`; its future completes while the node is spun."""
        call = PendingCall(self._node, client, request, read, timeout, self._servers, check)
        if not call.advance():
            with self._lock:
                self._pending.append(call)
            self._timer.reset()
            executor = self._executor()
            if executor is not None:  # it may be waiting without the restarted timer
                executor.wake()
        return call

    def call(
        self, client: Client, request: Any, read: Callable[[Any], Result], timeout: float
    ) -> Result:
        """Make a call and return its result; arguments as those of `PendingCall`.

        Raises:
            BlockedExecutorError: As in `result`; the request is then not sent.
            RepertoireTimeoutError: The deadline has passed.
        """
        self._require_waitable()
        result: Result = self.result(self.start(client, request, read, timeout))
        return result

    def result(self, call: PendingCall) -> Any:
        """Wait for the end of a call and return its result.

        Raises:
            BlockedExecutorError: Called in a callback of the executor that would have to handle the response.
            RepertoireTimeoutError: The deadline has passed.
        """
        try:
            self._require_waitable()
        except BlockedExecutorError:
            call.future.cancel()
            raise
        while not call.ended.wait(0.0 if self._spin_for(call) else TICK):
            if time.monotonic() > call.deadline + SPIN_GRACE:
                call.fail(
                    f"The executor of node '{self._node.get_name()}' handled no response before the deadline; spin it "
                    "in its own thread, or keep its callbacks short."
                )
        return call.future.result()

    def close(self) -> None:
        """Destroy the timer."""
        self._node.destroy_timer(self._timer)

    def _executor(self) -> Executor | None:
        """Return the executor that the node belongs to now; after rclpy.spin_once, node.executor is stale."""
        executor = self._node.executor
        return executor if executor is not None and self._node in executor.get_nodes() else None

    def _require_waitable(self) -> None:
        executor = self._executor()
        if executor is not None and _runs_here(executor):
            raise BlockedExecutorError(
                "A blocking call inside a callback would wait forever for its own executor. Use the method that "
                "ends in _async, with await or add_done_callback, or call from another thread."
            )

    def _spin_for(self, call: PendingCall) -> bool:
        """Spin the node until a call has ended, unless it is spun elsewhere.

        Returns:
            Whether it was spun.
        """
        if self._executor() is not None or not self._spinning.acquire(blocking=False):
            return False
        executor = SingleThreadedExecutor(context=self._node.context)
        try:
            executor.add_node(self._node)
            while not call.ended.is_set() and self._executor() is executor:
                executor.spin_once(timeout_sec=TICK)
        finally:
            executor.remove_node(self._node)
            executor.shutdown()
            self._spinning.release()
        return True

    def _tick(self) -> None:
        with self._lock:
            calls, self._pending = self._pending, []
        # Without the lock: the end of a call may run a done callback that starts another call.
        left = [call for call in calls if not call.advance()]
        with self._lock:
            self._pending += left
            if self._pending:
                self._timer.reset()  # another thread's tick may have canceled it
            else:
                self._timer.cancel()


def _runs_here(executor: Executor) -> bool:
    """Return whether the current thread is in a callback of an executor."""
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        if frame.f_code.co_filename == executors.__file__ and (
            frame.f_locals.get("self") is executor
        ):
            return True
        frame = frame.f_back
    return False
