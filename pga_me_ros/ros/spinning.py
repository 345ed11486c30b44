"""How the nodes of the graph spin: with rclpy's events executor, which looks only at what something happened to.

The executor of `rclpy.spin` asks each of a node's dozen services, subscriptions and timers at every pass, and takes two
passes per message: in a loop of short episodes, 2.5 % of all the work that a run does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

Callback = Callable[..., Any]

LONGEST_WAIT = 60.0
"""Seconds between two looks of a node to which nothing happens. rclpy's own `spin` sets no bound, that is, the latest
time that there is; the wheel's C++ library computes with it, overflows, and so waits without ever pausing."""


class EndingNode(Node):
    """A node that can end its own spinning without a word: what a callback raises, the executor logs as a fault.

    Attributes:
        outcome: Why spinning ends, None while it spins.
    """

    outcome: BaseException | None = None

    def end(self, outcome: BaseException) -> None:
        """End spinning, from any thread; the first outcome counts.

        Args:
            outcome: What `spin` is to raise.
        """
        self.outcome = self.outcome or outcome
        executor: Executor | None = self.executor
        if executor is not None:
            executor.create_task(lambda: None)  # wakes it, wherever it waits

    def unless_ended(self, callback: Callback) -> Callback:
        """Return a callback in whose middle a signal may come: what fails because of it ends the node, and is no fault.

        Args:
            callback: The callback. ROS 2 may be shut down while it works, or a KeyboardInterrupt be raised in it; None
                is returned then.
        """

        def call(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except KeyboardInterrupt as error:
                self.end(error)
            except Exception:
                if self.context.ok():
                    raise
                self.end(ExternalShutdownException())
            return None

        return call


def spin(node: EndingNode) -> None:
    """Serve a node's callbacks until it ends.

    Args:
        node: The node.

    Raises:
        BaseException: The node's `outcome`, or what a callback raised.
        ExternalShutdownException: ROS 2 was shut down, as by a signal.
    """
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    try:
        while node.outcome is None:
            executor.spin_once(timeout_sec=LONGEST_WAIT)
    finally:
        executor.shutdown()
    raise node.outcome
