"""The nodes of the graph spin with rclpy's events executor, which only handles what has had an event.

The executor of `rclpy.spin` checks each of a node's dozen services, subscriptions and timers at every pass, and needs
two passes per message: with short episodes, that is 2.5 % of all the work of a run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from pga_me_ros.process.dismantling import dismantling

Callback = Callable[..., Any]

LONGEST_WAIT = 60.0
"""Maximum seconds that an idle node waits. rclpy's own `spin` sets no bound, that is, the largest time there is; the
C++ library of the wheel overflows when it computes with it, and polls without a pause."""


class EndingNode(Node):
    """A node that can end its own spinning without an exception in a callback, which the executor would log as a fault.

    Its process ends, too, when ROS 2 does not get done with destroying it.

    Attributes:
        outcome: Why spinning ends, None while it spins.
    """

    outcome: BaseException | None = None

    def end(self, outcome: BaseException) -> None:
        """End spinning, from any thread; the first outcome counts.

        Args:
            outcome: Exception that `spin` will raise.
        """
        self.outcome = self.outcome or outcome
        executor: Executor | None = self.executor
        if executor is not None:
            executor.create_task(lambda: None)  # wakes the executor

    def destroy_node(self) -> None:
        """Destroy the node, within the time that `dismantling` allows."""
        with dismantling():
            super().destroy_node()

    def unless_ended(self, callback: Callback) -> Callback:
        """Return a callback that a signal may interrupt: failures due to the signal end the node and are not faults.

        Args:
            callback: The callback. If ROS 2 is shut down or a KeyboardInterrupt is raised while it runs, None is
                returned.
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
        ExternalShutdownException: ROS 2 was shut down, for example by a signal.
    """
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    try:
        while node.outcome is None:
            executor.spin_once(timeout_sec=LONGEST_WAIT)
    finally:
        executor.shutdown()
    raise node.outcome
