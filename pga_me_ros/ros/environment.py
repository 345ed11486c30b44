"""The environment of a process of the graph, before ROS 2 starts: discovery range, memory, security."""

from __future__ import annotations

import os
from collections.abc import Mapping, MutableMapping
from importlib.metadata import PackageNotFoundError, distribution

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.dds_choices import fill_in_dds_choices

LOGGING_SWITCHES = (
    "RCUTILS_COLORIZED_OUTPUT",
    "RCUTILS_LOGGING_BUFFERED_STREAM",
    "RCUTILS_LOGGING_USE_STDOUT",
)
"""Variables that must be 0 or 1, or ROS 2 ends the process without saying why."""

SECURITY = "ROS_SECURITY_ENABLE"

DOMAIN = "ROS_DOMAIN_ID"
LAST_DOMAIN = 232
"""DDS computes ports from the domain; those of higher ones do not exist, and Fast DDS prints lines of its source."""

WHEEL = "ros-rmw-fastrtps-cpp"
"""Distribution of the middleware if ROS 2 comes as wheels, whose Fast DDS is built without DDS security."""


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> None:
    """Set what the user has not: discovery is limited to this machine, and Fast DDS makes room for our messages.

    To be called before ``rclpy.init``; child processes inherit the result.

    Args:
        environment: Variables to read and to change; None for those of this process.

    Raises:
        SettingsError: A variable for logging, discovery or transports is invalid or has no effect, or DDS security is
            requested but unavailable.
    """
    variables = os.environ if environment is None else environment
    for name in LOGGING_SWITCHES:
        if variables.get(name, "") not in ("", "0", "1"):
            raise SettingsError(f"{name} is '{variables[name]}'; expected 0 or 1, or unset it.")
    domain_of(variables)
    fill_in_dds_choices(variables)
    # Exactly "true" counts for rcl, too.
    if variables.get(SECURITY) == "true" and not has_dds_security():
        raise SettingsError(
            f"{SECURITY} is true, but ROS 2 comes from wheels here, whose Fast DDS has no DDS security: nothing would "
            "be signed, encrypted or refused. Use a ROS 2 installation that has it, or unset the variable and see "
            "docs/security.md."
        )


def domain_of(variables: Mapping[str, str], last: int = LAST_DOMAIN) -> int:
    """Return the ROS domain that environment variables name, 0 for none.

    Args:
        variables: Environment variables.
        last: Greatest domain that may be given.

    Raises:
        SettingsError: It is no domain, or a greater one.
    """
    given = variables.get(DOMAIN, "")
    text = given.strip()
    if text and not (text.isascii() and text.isdecimal() and int(text) <= last):
        raise SettingsError(
            f"{DOMAIN} is '{given}'; expected a whole number from 0 to {last}, or unset it."
        )
    return int(text or 0)


def has_dds_security() -> bool:
    """Whether the middleware may have DDS security; the one from the wheels has none."""
    try:
        distribution(WHEEL)
    except PackageNotFoundError:
        return True
    return False
