"""Discovery and transports: the user's choices for ROS 2 and Fast DDS stay, and the rest is filled in."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, MutableMapping
from pathlib import Path

from pga_me_ros.errors import SettingsError, nearest_name

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("OFF", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"
"""The older way to choose LOCALHOST; it takes precedence over DISCOVERY_RANGE."""

STATIC_PEERS = "ROS_STATIC_PEERS"
DISCOVERY_SERVER = "ROS_DISCOVERY_SERVER"

TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
PROFILES_IN_FOLDER = ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml")
"""Profiles that Fast DDS loads from the working directory, unless SKIP_PROFILES_IN_FOLDER is 1."""

SKIP_PROFILES_IN_FOLDER = "SKIP_DEFAULT_XML_FILE"
QOS_FROM_PROFILES = "RMW_FASTRTPS_USE_QOS_FROM_XML"
PUBLICATION_MODE = "RMW_FASTRTPS_PUBLICATION_MODE"
ENVIRONMENT_FILE = "FASTDDS_ENVIRONMENT_FILE"
"""JSON file from which Fast DDS reads its variables before the environment."""

OUR_PROFILES = Path(__file__).with_name("fastdds.xml")
"""Shared memory with room for our messages, and UDP; buffers are returned to the system. The file explains how."""

OUR_UDP_PROFILES = Path(__file__).with_name("fastdds_udp.xml")
"""The same with UDP only, on this machine only."""

OUR_MEMORY_PROFILES = Path(__file__).with_name("fastdds_memory.xml")
"""The same with whatever transports the user has chosen."""

OURS = {str(path) for path in (OUR_PROFILES, OUR_UDP_PROFILES, OUR_MEMORY_PROFILES)}

SHARED_MEMORY = Path("/dev/shm")

LOCAL_NOTE = (
    f"nodes are found on this machine only; for others, export {DISCOVERY_RANGE}=SUBNET on each"
)
"""Hint for users who may be waiting for nodes of other machines."""


def fill_in_dds_choices(variables: MutableMapping[str, str]) -> None:
    """Set the discovery range and the Fast DDS profiles unless the user has set them or something incompatible.

    In the range LOCALHOST, rmw_fastrtps adds its own transports, shared memory and UDPv4. So that range is not set if
    the user has chosen other transports.

    Args:
        variables: Environment to look at and to change.

    Raises:
        SettingsError: The range is unknown, or it makes rmw_fastrtps ignore the chosen transports.
    """
    if variables.get(PROFILES[0]) in OURS:
        return  # the parent process has filled them in
    given = variables.get(DISCOVERY_RANGE, "")
    if given and given not in RANGES:  # rcl would use LOCALHOST
        raise SettingsError(
            f"{DISCOVERY_RANGE} is '{given}'{nearest_name(given, RANGES)}; expected one of: "
            f"{', '.join(RANGES)}."
        )
    range_is_open = not (
        given or variables.get(LOCALHOST_ONLY) or fastdds_variable(variables, DISCOVERY_SERVER)
    )
    transports = fastdds_variable(variables, TRANSPORTS)
    if _has_profiles(variables):
        if range_is_open and not transports and not _profiles_have_transports(variables):
            variables[DISCOVERY_RANGE] = "LOCALHOST"
        return
    if transports in ("", "DEFAULT"):
        profiles = OUR_PROFILES
        if range_is_open:
            variables[DISCOVERY_RANGE] = "LOCALHOST"
    elif transports == "UDPv4" and _is_alone(variables, given, range_is_open):
        profiles = OUR_UDP_PROFILES
        variables[DISCOVERY_RANGE] = "SYSTEM_DEFAULT"  # the profile is limited to this machine
    else:
        profiles = OUR_MEMORY_PROFILES
        _refuse_ignored(transports, variables, given)
    variables[PROFILES[0]] = str(profiles)
    # rmw_fastrtps uses the publication mode only if QoS does not come from profiles.
    if not variables.get(PUBLICATION_MODE):
        variables[QOS_FROM_PROFILES] = "1"


def is_local(variables: Mapping[str, str] = os.environ) -> bool:
    """Whether discovery is limited to this machine."""
    if variables.get(LOCALHOST_ONLY) == "1" or variables.get(PROFILES[0]) == str(OUR_UDP_PROFILES):
        return True
    if variables.get(STATIC_PEERS) or fastdds_variable(variables, DISCOVERY_SERVER):
        return False
    return variables.get(DISCOVERY_RANGE) in ("LOCALHOST", "OFF")


def other_users_note() -> str:
    """Return a hint for a node that may be another user's; empty if no other user has nodes on this machine.

    Fast DDS's shared memory is private to its user: nodes of two users find each other, but no message arrives.
    """
    if fastdds_variable(os.environ, TRANSPORTS).startswith("UDP"):
        return ""
    for segment in SHARED_MEMORY.glob("fastrtps_*"):
        try:
            if segment.stat().st_uid != os.geteuid():
                return (
                    " Other users run ROS 2 nodes on this machine, and shared memory does not connect them with "
                    f"yours; if it is one of theirs, export {TRANSPORTS}=UDPv4 before you start this."
                )
        except OSError:  # its process has just ended
            continue
    return ""


def fastdds_variable(variables: Mapping[str, str], name: str) -> str:
    """Return a variable as Fast DDS reads it, "" if it is not set; its environment file takes precedence."""
    try:
        content = json.loads(Path(variables.get(ENVIRONMENT_FILE, "")).read_bytes())
    except (OSError, ValueError):  # Fast DDS ignores such a file, too
        content = {}
    value = content.get(name) if isinstance(content, dict) else None
    return value if isinstance(value, str) else variables.get(name, "")


def _is_alone(variables: Mapping[str, str], given: str, range_is_open: bool) -> bool:
    """Whether only nodes of this machine are wanted."""
    if variables.get(STATIC_PEERS) or variables.get(LOCALHOST_ONLY) == "1":
        return False
    return range_is_open or given == "LOCALHOST"


def _refuse_ignored(transports: str, variables: Mapping[str, str], given: str) -> None:
    """Refuse transports that rmw_fastrtps would replace."""
    local = f"{LOCALHOST_ONLY}=1" if variables.get(LOCALHOST_ONLY) == "1" else ""
    local = local or (f"{DISCOVERY_RANGE}=LOCALHOST" if given == "LOCALHOST" else "")
    if local:
        raise SettingsError(
            f"{TRANSPORTS}={transports} has no effect together with {local}, for which ROS 2 brings shared memory "
            f"and UDPv4; unset one of them, or export {DISCOVERY_RANGE}=SUBNET."
        )


def _has_profiles(variables: Mapping[str, str]) -> bool:
    """Whether the user has Fast DDS profiles, or has set whether QoS comes from profiles."""
    return QOS_FROM_PROFILES in variables or bool(_profiles(variables))


def _profiles(variables: Mapping[str, str]) -> list[Path]:
    """Return the files with the user's Fast DDS profiles."""
    files = [Path(variables[name]) for name in PROFILES if name in variables]
    if not variables.get(SKIP_PROFILES_IN_FOLDER, "").startswith("1"):
        files += [path for name in PROFILES_IN_FOLDER if (path := Path(name)).is_file()]
    return files


def _profiles_have_transports(variables: Mapping[str, str]) -> bool:
    """Whether the user's profiles choose transports, to which rmw_fastrtps would add its own in the range LOCALHOST."""
    for path in _profiles(variables):
        try:
            text = path.read_text(errors="replace")
        except OSError:  # Fast DDS will report it
            continue
        if any(tag in text for tag in ("<userTransports", "<builtinTransports")):
            return True
    return False
