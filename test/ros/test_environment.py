"""The user's choices for discovery and transports stay; the rest is filled in."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from domain_coordinator import domain_id

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.dds_choices import (
    DISCOVERY_RANGE,
    OUR_MEMORY_PROFILES,
    OUR_PROFILES,
    OUR_UDP_PROFILES,
    PROFILES,
    QOS_FROM_PROFILES,
    SKIP_PROFILES_IN_FOLDER,
    TRANSPORTS,
    is_local,
)
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.graph_node import HEARTBEAT

FILE = PROFILES[0]
QOS = {QOS_FROM_PROFILES: "1"}
DEADLINE = 60.0


@pytest.mark.parametrize(
    ("given", "added", "local"),
    [
        ({}, {DISCOVERY_RANGE: "LOCALHOST", FILE: str(OUR_PROFILES), **QOS}, True),
        (
            {TRANSPORTS: "DEFAULT"},
            {DISCOVERY_RANGE: "LOCALHOST", FILE: str(OUR_PROFILES), **QOS},
            True,
        ),
        (
            {TRANSPORTS: "UDPv4"},
            {DISCOVERY_RANGE: "SYSTEM_DEFAULT", FILE: str(OUR_UDP_PROFILES), **QOS},
            True,
        ),
        (
            {TRANSPORTS: "UDPv4", DISCOVERY_RANGE: "LOCALHOST"},
            {DISCOVERY_RANGE: "SYSTEM_DEFAULT", FILE: str(OUR_UDP_PROFILES), **QOS},
            True,
        ),
        (
            {TRANSPORTS: "UDPv4", DISCOVERY_RANGE: "SUBNET"},
            {FILE: str(OUR_MEMORY_PROFILES), **QOS},
            False,
        ),
        (
            {TRANSPORTS: "UDPv4", "ROS_STATIC_PEERS": "192.0.2.1"},
            {FILE: str(OUR_MEMORY_PROFILES), **QOS},
            False,
        ),
        (
            {TRANSPORTS: "LARGE_DATA?max_msg_size=1MB"},
            {FILE: str(OUR_MEMORY_PROFILES), **QOS},
            False,
        ),
        (
            {"RMW_FASTRTPS_PUBLICATION_MODE": "ASYNCHRONOUS"},
            {DISCOVERY_RANGE: "LOCALHOST", FILE: str(OUR_PROFILES)},
            True,
        ),
        ({"ROS_DISCOVERY_SERVER": "192.0.2.1:11811"}, {FILE: str(OUR_PROFILES), **QOS}, False),
        (
            {"ROS_STATIC_PEERS": "192.0.2.1"},
            {DISCOVERY_RANGE: "LOCALHOST", FILE: str(OUR_PROFILES), **QOS},
            False,
        ),
    ],
)
def test_only_unset_variables_are_filled_in(
    given: dict[str, str], added: dict[str, str], local: bool
) -> None:
    variables = dict(given)
    prepare_environment(variables)
    assert variables == given | added
    assert is_local(variables) is local
    prepare_environment(variables)  # again, like a child process
    assert variables == given | added


@pytest.mark.parametrize("tag", ["userTransports", "builtinTransports"])
@pytest.mark.parametrize("where", ["variable", "folder"])
def test_the_range_is_not_set_if_the_users_profiles_have_transports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tag: str, where: str
) -> None:
    # rmw_fastrtps adds shared memory in the range LOCALHOST.
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml"
    given = {FILE: str(path)} if where == "variable" else {}
    for text, added in (
        (f"<{tag}>UDPv4</{tag}>", {}),
        ("<data_writer/>", {DISCOVERY_RANGE: "LOCALHOST"}),
    ):
        path.write_text(f"<profiles>{text}</profiles>")
        variables = dict(given)
        prepare_environment(variables)
        assert variables == given | added
    skipping = {SKIP_PROFILES_IN_FOLDER: "1"}
    prepare_environment(skipping)
    assert skipping[FILE] == str(OUR_PROFILES)


@pytest.mark.parametrize("profiles", [OUR_PROFILES, OUR_UDP_PROFILES, OUR_MEMORY_PROFILES])
def test_announcements_that_others_missed_are_repeated_soon(profiles: Path) -> None:
    builtin = "r:participant/r:rtps/r:builtin/r:discovery_config/r:leaseAnnouncement"
    space = {"r": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}
    repeated = ET.parse(profiles).getroot().find(builtin, space)
    assert repeated is not None
    unit = {part.tag.rpartition("}")[2]: int(part.text or 0) for part in repeated}
    seconds = unit.get("sec", 0) + unit.get("nanosec", 0) * 1e-9
    assert 0 < seconds < HEARTBEAT  # by itself Fast DDS waits 3 s


def test_transports_in_the_environment_file_of_fast_dds_take_precedence(tmp_path: Path) -> None:
    file = tmp_path / "environment.json"
    file.write_text(json.dumps({TRANSPORTS: "UDPv4"}))
    variables = {"FASTDDS_ENVIRONMENT_FILE": str(file), TRANSPORTS: "SHM"}
    prepare_environment(variables)
    assert variables[FILE] == str(OUR_UDP_PROFILES)
    file.write_text("not JSON")
    variables = {"FASTDDS_ENVIRONMENT_FILE": str(file)}
    prepare_environment(variables)
    assert variables[FILE] == str(OUR_PROFILES)


@pytest.mark.parametrize(
    "given",
    [
        {TRANSPORTS: "LARGE_DATA", DISCOVERY_RANGE: "LOCALHOST"},
        {TRANSPORTS: "UDPv4", "ROS_LOCALHOST_ONLY": "1"},
    ],
)
def test_transports_that_ros_2_would_ignore_are_refused(given: dict[str, str]) -> None:
    with pytest.raises(SettingsError, match="has no effect together with") as error:
        prepare_environment(given)
    assert all(name in str(error.value) for name in given)


def test_a_range_that_ros_2_does_not_know_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"'SUBNETS' \(did you mean 'SUBNET'\?\)"):
        prepare_environment({DISCOVERY_RANGE: "SUBNETS"})


def without_transports(path: Path) -> str:
    """Return a profile without its transports and initial peers."""
    root = ET.parse(path).getroot()
    names = ("Transports", "transport_descriptors", "LocatorList", "PeersList")
    for parent in list(root.iter()):
        for child in [c for c in parent if c.tag.endswith(names)]:
            parent.remove(child)
    return ET.canonicalize(ET.tostring(root, encoding="unicode"), strip_text=True)


def test_our_profiles_differ_only_in_transports() -> None:
    (memory,) = {
        without_transports(p) for p in (OUR_PROFILES, OUR_UDP_PROFILES, OUR_MEMORY_PROFILES)
    }
    assert "historyMemoryPolicy>DYNAMIC<" in memory


WHOM_I_HEAR = """
import os
from pga_me_ros.ros.environment import prepare_environment
prepare_environment()
import rclpy
rclpy.init()
node = rclpy.create_node("udp")
links = [os.readlink(f"/proc/self/fd/{fd}") for fd in range(64) if os.path.exists(f"/proc/self/fd/{fd}")]
mine = {link[8:-1] for link in links if link.startswith("socket:[")}
rows = [line.split() for line in open("/proc/self/net/udp")][1:]
print(*[int(row[1].split(":")[1], 16) for row in rows if row[9] in mine])
rclpy.shutdown()
"""


@pytest.mark.parametrize("network_range", [None, "SUBNET"])
def test_udp_nodes_hear_the_subnet_only_if_told_to(network_range: str | None) -> None:
    env = {k: v for k, v in os.environ.items() if k not in (DISCOVERY_RANGE, *PROFILES, *QOS)}
    env |= {TRANSPORTS: "UDPv4", **({DISCOVERY_RANGE: network_range} if network_range else {})}
    with domain_id() as domain:
        out = subprocess.run(
            [sys.executable, "-c", WHOM_I_HEAR],
            env=env | {"ROS_DOMAIN_ID": str(domain)},
            capture_output=True,
            text=True,
            check=True,
        )
    ports = {int(port) for port in out.stdout.split()}
    assert ports
    multicast = 7400 + 250 * domain  # the port for discovery of other machines
    assert (multicast in ports) == (network_range == "SUBNET")


@pytest.mark.parametrize("module", ["nodes.archive_manager", "replay"])
def test_a_middleware_that_is_not_installed_is_refused_in_one_line(module: str) -> None:
    # rclpy would end the process with status 102 when it is imported.
    ended = subprocess.run(
        [sys.executable, "-m", f"pga_me_ros.{module}", "--help"],
        env={**os.environ, "RMW_IMPLEMENTATION": "rmw_of_mars_cpp"},
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert line.startswith("error: RMW_IMPLEMENTATION is 'rmw_of_mars_cpp', but")
    assert "rmw_fastrtps_cpp; unset the variable" in line


def test_the_shells_setup_says_which_middleware_it_replaces() -> None:
    setup = Path(__file__).parents[2] / "scripts" / "setup.bash"
    sourced = subprocess.run(
        ["bash", "-c", f". {setup} && echo $RMW_IMPLEMENTATION"],
        env={"PATH": os.environ["PATH"], "RMW_IMPLEMENTATION": "rmw_of_mars_cpp"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert sourced.stdout == "rmw_fastrtps_cpp\n"
    assert sourced.stderr.startswith("RMW_IMPLEMENTATION was rmw_of_mars_cpp;")
