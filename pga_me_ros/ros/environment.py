"""What a process of the graph takes from its environment before ROS 2 starts: how far it is heard, memory, security."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from importlib.metadata import PackageNotFoundError, distribution

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.dds_choices import fill_in_dds_choices

LOGGING_SWITCHES = (
    "RCUTILS_COLORIZED_OUTPUT",
    "RCUTILS_LOGGING_BUFFERED_STREAM",
    "RCUTILS_LOGGING_USE_STDOUT",
)
"""Variables for which ROS 2 ends a process without saying why if they are neither 0 nor 1."""

SECURITY = "ROS_SECURITY_ENABLE"

WHEEL = "ros-rmw-fastrtps-cpp"
"""Distribution of the middleware where ROS 2 comes as wheels, whose Fast DDS is built without DDS security."""


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> None:
    """Fill in what the user left open: nodes keep to this machine, and Fast DDS makes room for our messages.

    To be called before ``rclpy.init``; child processes inherit the result.

    Args:
        environment: Variables to look at and to change; None takes those of the process.

    Raises:
        SettingsError: What is chosen for logging, discovery or transports has no meaning or no effect, or DDS security
            is requested but unavailable.
    """
    variables = os.environ if environment is None else environment
    for name in LOGGING_SWITCHES:
        if variables.get(name, "") not in ("", "0", "1"):
            raise SettingsError(f"{name} is '{variables[name]}'; expected 0 or 1, or unset it.")
    fill_in_dds_choices(variables)
    # rcl takes exactly "true" for yes, too.
    if variables.get(SECURITY) == "true" and not has_dds_security():
        raise SettingsError(
            f"{SECURITY} is true, but ROS 2 comes from wheels here, whose Fast DDS has no DDS security: nothing would "
            "be signed, encrypted or refused. Use a ROS 2 installation that has it, or unset the variable and see "
            "docs/security.md."
        )


def has_dds_security() -> bool:
    """Whether the middleware may have DDS security: that of the wheels has not."""
    try:
        distribution(WHEEL)
    except PackageNotFoundError:
        return True
    return False
