"""Discovery range: nodes stay on their machine unless told otherwise; security is not faked."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.dds_choices import (
    DISCOVERY_RANGE,
    LOCALHOST_ONLY,
    OUR_PROFILES,
    PROFILES,
    QOS_FROM_PROFILES,
    is_local,
)
from pga_me_ros.ros.environment import SECURITY, has_dds_security, prepare_environment

DEADLINE = 60.0


def wait_until(true: Callable[[], bool], what: str) -> None:
    deadline, pause = time.monotonic() + DEADLINE, threading.Event()
    while not true():
        assert time.monotonic() < deadline, f"waited {DEADLINE} s for: {what}"
        pause.wait(0.05)


@contextmanager
def node_of_ours(domain: int, log: Path, **variables: str) -> Iterator[subprocess.Popen[bytes]]:
    """Start an evaluator in an environment without range and profiles, except those given."""
    filled_in = (DISCOVERY_RANGE, LOCALHOST_ONLY, *PROFILES, QOS_FROM_PROFILES)
    env = {k: v for k, v in os.environ.items() if k not in filled_in}
    env |= {"ROS_DOMAIN_ID": str(domain), **variables}
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "pga_me_ros.nodes.evaluator"],
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def node_of_a_user(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[rclpy.node.Node]:
    """Make a plain node in this process with ROS 2's default range, the subnet."""
    monkeypatch.delenv(DISCOVERY_RANGE, raising=False)
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("user", context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.shutdown()


def udp_ports(pid: int) -> set[int]:
    """Return the UDP ports that a process listens on, according to the kernel."""
    links = [os.readlink(fd) for fd in Path(f"/proc/{pid}/fd").iterdir() if fd.is_symlink()]
    inodes = {link[8:-1] for link in links if link.startswith("socket:[")}
    rows = [row.split() for row in Path(f"/proc/{pid}/net/udp").read_text().splitlines()[1:]]
    return {int(row[1].split(":")[1], 16) for row in rows if row[9] in inodes}


@pytest.mark.parametrize(
    ("variables", "hears_subnet"), [({}, False), ({DISCOVERY_RANGE: "SUBNET"}, True)]
)
def test_a_node_listens_to_the_subnet_only_if_told_to_but_plain_nodes_find_it(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    variables: dict[str, str],
    hears_subnet: bool,
) -> None:
    with (
        domain_id() as domain,
        node_of_ours(domain, tmp_path / "log", **variables) as process,
        node_of_a_user(domain, monkeypatch) as user,
    ):
        wait_until(
            lambda: any(
                name.endswith("/evaluate") for name, _ in user.get_service_names_and_types()
            ),
            f"the evaluator: {(tmp_path / 'log').read_text()}",
        )
        # DDS's metatraffic multicast port: other machines are discovered by multicast.
        multicast = 7400 + 250 * domain
        assert multicast in udp_ports(os.getpid())
        assert (multicast in udp_ports(process.pid)) == hears_subnet


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {DISCOVERY_RANGE: "LOCALHOST"}),
        ({DISCOVERY_RANGE: "SUBNET"}, {DISCOVERY_RANGE: "SUBNET"}),
        ({DISCOVERY_RANGE: "SYSTEM_DEFAULT"}, {DISCOVERY_RANGE: "SYSTEM_DEFAULT"}),
        ({LOCALHOST_ONLY: "0"}, {LOCALHOST_ONLY: "0"}),
    ],
)
def test_the_users_range_counts(given: dict[str, str], expected: dict[str, str]) -> None:
    own_profiles = {QOS_FROM_PROFILES: "0"}
    given |= own_profiles
    prepare_environment(given)
    assert given == expected | own_profiles


@pytest.mark.parametrize("name", [*PROFILES, QOS_FROM_PROFILES])
def test_profiles_of_the_user_are_not_changed(name: str) -> None:
    without: dict[str, str] = {}
    prepare_environment(without)
    assert Path(without[PROFILES[0]]) == OUR_PROFILES
    assert OUR_PROFILES.is_file()
    given = {name: "theirs"}
    prepare_environment(given)
    assert {n: v for n, v in given.items() if n != DISCOVERY_RANGE} == {name: "theirs"}


@pytest.mark.parametrize(
    ("name", "value", "local"),
    [
        (DISCOVERY_RANGE, "LOCALHOST", True),
        (DISCOVERY_RANGE, "OFF", True),
        (DISCOVERY_RANGE, "SUBNET", False),
        (LOCALHOST_ONLY, "1", True),
    ],
)
def test_whether_discovery_is_limited_to_this_machine(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, local: bool
) -> None:
    monkeypatch.delenv(DISCOVERY_RANGE, raising=False)
    monkeypatch.setenv(name, value)
    assert is_local() is local


@pytest.mark.skipif(has_dds_security(), reason="this ROS 2 is no wheel: its DDS may have security")
def test_no_node_starts_if_security_is_requested_but_unavailable() -> None:
    # The default strategy, Permissive, would let it run unprotected with hardly a warning.
    ended = subprocess.run(
        [sys.executable, "-m", "pga_me_ros.nodes.archive_manager"],
        env={**os.environ, SECURITY: "true"},
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"error: {SECURITY} is true, but ROS 2 comes from wheels here")


@pytest.mark.skipif(has_dds_security(), reason="this ROS 2 is no wheel: its DDS may have security")
def test_security_that_is_off_is_accepted() -> None:
    prepare_environment({SECURITY: "false"})
    with pytest.raises(SettingsError, match="no DDS security"):
        prepare_environment({SECURITY: "true"})
