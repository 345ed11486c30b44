"""If several orchestrators have the same name, the first one stays."""

from __future__ import annotations

import os
import socket

from pga_me_msgs.msg import NodeStatus, Progress

from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.calls import StoppedError, Waiter
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.team import SINGLETONS, name_is_taken
from pga_me_ros.process.machine_name import HeldNameError, MachineName
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.dds_choices import DISCOVERY_SERVER, fastdds_variable
from pga_me_ros.ros.namesakes import LISTEN_ON, listening_time
from pga_me_ros.ros.refusals import printable


def name_on_this_machine(control: Control) -> MachineName:
    """Hold the orchestrator's name on this machine, and return what releases it.

    Whether two that start at once hear each other in time depends on how busy the machine is. If they do not, each goes
    on, and ends when it finds the other's nodes. On one machine, the kernel decides between them, whatever they hear.

    Raises:
        PgaError: Another orchestrator has the name.
    """
    # Nodes of two discovery servers do not find each other, so both may have a run of one name in one domain.
    server = fastdds_variable(os.environ, DISCOVERY_SERVER)
    domain = str(control.context.get_domain_id())
    try:
        return MachineName("orchestrator", domain, control.get_namespace(), server)
    except HeldNameError as error:
        process = f"process {error.pid}" if error.pid else "unknown process"
        raise _another_runs(control, f"{process} on {socket.gethostname()}") from None


def require_free_name(control: Control, claim: Progress, *, new: bool) -> None:
    """Make sure that no other orchestrator runs in this namespace, on another machine or as another user.

    If several start at the same time, the one with the oldest claim stays.

    Args:
        control: The orchestrator's node.
        claim: What it has published about itself, without a run yet.
        new: Whether the run's folder is yet to be created. There must then be no other run's nodes, either. If a run is
            resumed, they may be its own, which have yet to notice that their orchestrator was killed.

    Raises:
        PgaError: Another orchestrator or one of its nodes has the name.
    """
    heard: list[Progress] = []
    strangers: list[NodeStatus] = []
    waiter = Waiter(lambda: stop_if_asked(control))

    def take(msg: Progress) -> None:
        if (
            not heard
            and (msg.host, msg.pid) != (socket.gethostname(), os.getpid())
            and (msg.run_id or age(msg) < age(claim))
        ):
            heard.append(msg)
            waiter.wake()

    def take_node(msg: NodeStatus) -> None:
        if new and not strangers and msg.kind in SINGLETONS:
            strangers.append(msg)

    control.create_subscription(Progress, names.PROGRESS, take, qos.CLAIMS)
    control.create_subscription(NodeStatus, names.STATUS, take_node, qos.STATUS)
    wait = control.options.discovery_wait
    waiter.until(lambda: bool(heard), wait)
    more = listening_time(control, control.get_name(), wait=wait) - wait
    waiter.until(lambda: bool(heard), more)
    if strangers:  # if they have an orchestrator, it says more about them
        waiter.until(lambda: bool(heard), LISTEN_ON)
    if heard:
        who = f"process {heard[0].pid} on {heard[0].host}, task {heard[0].task}"
        raise _another_runs(control, printable(who))
    if strangers:
        raise name_is_taken(strangers[0])


def _another_runs(control: Control, who: str) -> PgaError:
    """Return the error for an orchestrator whose name another one has."""
    return PgaError(
        f"Another orchestrator runs as {control.get_fully_qualified_name()} ({who}). "
        "Stop it, or give this one a namespace (--ros-args -r __ns:=/NAME) or another ROS_DOMAIN_ID."
    )


def stop_if_asked(control: Control) -> None:
    """End a wait if the user has stopped the run.

    Raises:
        StoppedError: The user stopped the run.
    """
    if control.stop_requested.is_set():
        raise StoppedError


def age(claim: Progress) -> tuple[int, int, str, int]:
    """Return the sort key of a claim to a name: the smallest is the oldest."""
    return claim.stamp.sec, claim.stamp.nanosec, claim.host, claim.pid
