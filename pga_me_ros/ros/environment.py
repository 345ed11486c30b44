"""What a process of the graph takes from its environment before ROS 2 starts: how far it is heard, memory, security."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from pga_me_ros.core.errors import SettingsError

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"
SECURITY = "ROS_SECURITY_ENABLE"

WHEEL = "ros-rmw-fastrtps-cpp"
"""Distribution of the middleware where ROS 2 comes as wheels, whose Fast DDS is built without DDS security."""

PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
QOS_FROM_PROFILES = "RMW_FASTRTPS_USE_QOS_FROM_XML"
OUR_PROFILES = Path(__file__).with_name("fastdds.xml")
"""Has Fast DDS make room for our messages and give their memory back; it says how."""

LOCAL_NOTE = (
    f"nodes are found on this machine only; for others, export {DISCOVERY_RANGE}=SUBNET on each"
)
"""What to say where somebody may wait for nodes of other machines."""


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> None:
    """Keep ROS 2 to this machine and its memory small unless told otherwise; refuse a security that there is none of.

    To be called before ``rclpy.init``; child processes inherit the result.

    Args:
        environment: Variables to look at and to change; None takes those of the process.

    Raises:
        SettingsError: DDS security is asked for, but the installed middleware has none.
    """
    variables = os.environ if environment is None else environment
    # ROS_LOCALHOST_ONLY is the older way to say the same; who uses it has decided.
    if LOCALHOST_ONLY not in variables:
        variables.setdefault(DISCOVERY_RANGE, "LOCALHOST")
    # Who has profiles has set more than we know; ours would take their place.
    if not any(name in variables for name in (*PROFILES, QOS_FROM_PROFILES)):
        variables[PROFILES[0]] = str(OUR_PROFILES)
        variables[QOS_FROM_PROFILES] = "1"
    # rcl takes exactly "true" for yes, too.
    if variables.get(SECURITY) == "true" and not has_dds_security():
        raise SettingsError(
            f"{SECURITY} is true, but ROS 2 comes from wheels here, whose Fast DDS has no DDS security: nothing would "
            "be signed, encrypted or refused. Use a ROS 2 installation that has it, or unset the variable and see "
            "docs/security.md."
        )


def is_local() -> bool:
    """Whether nodes of other machines will not be discovered."""
    return (
        os.environ.get(DISCOVERY_RANGE) in ("LOCALHOST", "OFF")
        or os.environ.get(LOCALHOST_ONLY) == "1"
    )


def has_dds_security() -> bool:
    """Whether the middleware may have DDS security: that of the wheels has not."""
    try:
        distribution(WHEEL)
    except PackageNotFoundError:
        return True
    return False
