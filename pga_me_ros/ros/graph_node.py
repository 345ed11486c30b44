"""What all nodes of the graph share: heartbeats, and services that refuse bad requests with a reason."""

from __future__ import annotations

import os
import re
import socket
import threading
import traceback
from collections.abc import Callable, Mapping
from itertools import count
from typing import Any

from pga_me_msgs.msg import NodeStatus
from rclpy._rclpy_pybind11 import RCLError
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.service import Service

from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.diagnostics import Diagnostics
from pga_me_ros.ros.refusals import CalmRefusals, printable
from pga_me_ros.ros.shield import shield
from pga_me_ros.ros.spinning import EndingNode

HEARTBEAT = 1.0
"""Seconds between two heartbeats."""

FIRST_HEARTBEATS = 20
FIRST_PAUSE = 0.1
"""Number of heartbeats that follow each other faster, and seconds between them: a run waits for one, and the first may
come before its node has been discovered."""

LONGEST_ANSWER = 2000
"""Maximum characters of a refusal that are sent back: enough for every cause, whatever the request held."""

Handler = Callable[[Any, Any], None]


def own_name(kind: str) -> str:
    """Return a node name that is unique in the network: kind, host and process id."""
    return re.sub(r"\W", "_", f"{kind}_{socket.gethostname()}_{os.getpid()}", flags=re.ASCII)


class GraphNode(EndingNode):
    """A node that publishes `NodeStatus` and whose services turn errors into refusals.

    Args:
        kind: The kind in its status.
        name: Default node name; empty for the kind.

    Attributes:
        diagnostics: Its entry in /diagnostics.
    """

    def __init__(self, kind: str, name: str = "") -> None:
        super().__init__(name or kind, automatically_declare_parameters_from_overrides=True)
        self._refusals = CalmRefusals()
        shield(self, self.refused)
        self._beat = NodeStatus(
            node=self.get_fully_qualified_name(),
            kind=kind,
            host=socket.gethostname(),
            pid=os.getpid(),
        )
        self._status = self.create_publisher(NodeStatus, names.STATUS, qos.STATUS)
        self.diagnostics = Diagnostics(self)
        self._ended = threading.Event()
        self._heart = threading.Thread(target=self._live, name="heartbeat", daemon=True)

    def start_heartbeat(self, *, run_id: str = "", task: str = "", versions: str = "") -> None:
        """Announce that this node is ready: call it when all services are up."""
        self._beat.run_id, self._beat.task, self._beat.versions = run_id, task, versions
        self.diagnostics.run_id = run_id
        self._heart.start()

    def count_done(self, n: int = 1) -> None:
        """Count finished work in the status."""
        self._beat.done += n

    def serve(
        self,
        srv_type: Any,
        name: str,
        handler: Handler,
        ok_field: str = "accepted",
        qos_profile: QoSProfile = qos_profile_services_default,
    ) -> Service:
        """Offer a service whose handler fills the response or raises.

        Args:
            srv_type: Service type; its response has a bool ``ok_field`` and a string ``message``.
            name: Relative name.
            handler: ``handler(request, response)``; an exception becomes a refusal.
            ok_field: The response's field that says whether the request was served.
            qos_profile: Quality of service.
        """

        def callback(request: Any, response: Any) -> Any:
            try:
                setattr(response, ok_field, True)
                handler(request, response)
            except PgaError as error:
                self._refuse(response, ok_field, name, str(error))
            except Exception as error:  # a fault must not end the node
                if not self.context.ok():  # not a fault: a signal came in the middle of the work
                    raise
                self.get_logger().error(traceback.format_exc())
                reason = f"internal fault: {type(error).__name__}: {error}"
                self._refuse(response, ok_field, name, reason)
                self.diagnostics.fault(self._beat.last_error)
            return response

        service = self.create_service(
            srv_type, name, self.unless_ended(callback), qos_profile=qos_profile
        )
        send = service.send_response

        def answer(response: Any, header: Any) -> None:
            if (
                response is not None
            ):  # None if the node is ending; the caller will ask its successor
                send(response, header)

        setattr(service, "send_response", answer)  # noqa: B010, a method of rclpy's
        return service

    def check_run(self, run_id: str, ours: str) -> None:
        """Refuse a request that does not belong to this run.

        Raises:
            RequestError: The run ids differ.
        """
        if run_id != ours:
            raise RequestError(
                f"This request is for run '{run_id}', but this node works for run '{ours}'. "
                "Use another namespace or ROS domain for another run."
            )

    def health(self) -> Mapping[str, object]:
        """Return further values for /diagnostics; called once a second in the heartbeat's thread."""
        return {}

    def destroy_node(self) -> None:
        """Stop the heartbeat, then destroy the node."""
        self._ended.set()
        if self._heart.is_alive():
            self._heart.join()
        super().destroy_node()

    def refused(self, reason: str) -> None:
        """Note a refusal or a message that was dropped, in the log and in the status."""
        self._beat.refused += 1
        self._beat.last_error = printable(reason)
        self.diagnostics.disturbance(self._beat.last_error)
        line = self._refusals.line(self._beat.last_error)
        if line is not None:
            self.get_logger().warning(line)

    def _refuse(self, response: Any, ok_field: str, name: str, reason: str) -> None:
        self.refused(f"refused a request to {name}: {reason}")
        setattr(response, ok_field, False)
        response.message = printable(reason, LONGEST_ANSWER)

    def _live(self) -> None:
        quick = round(HEARTBEAT / FIRST_PAUSE)
        for beat in count():
            pause = FIRST_PAUSE if beat < FIRST_HEARTBEATS else HEARTBEAT
            try:
                self._status.publish(self._beat)
                if pause == HEARTBEAT or beat % quick == 0:  # once a second in either case
                    self.diagnostics.publish(self._beat.done, self._beat.refused, self.health())
            except RCLError:
                if self.context.ok():
                    raise
                return  # a signal shut the context down between two heartbeats
            if self._ended.wait(pause):
                return
