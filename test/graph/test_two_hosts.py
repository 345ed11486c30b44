"""A run on two hosts whose network fails continues, and ends with the repertoire of an undisturbed run.

`make two-hosts` runs this test; it takes minutes, in most of which a cable is unplugged.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from graph import Started, wait_until
from hosts import Host, Network, NotPermittedError
from reference import evaluations_of, run_digest, search_digest

pytestmark = pytest.mark.two_hosts

OBSERVER = Path(__file__).with_name("observer.py")

LONG = {"evaluations": 100_000}
"""Evaluations of a run that is still running when the cable is plugged in again."""

MORE = 50
"""Evaluations with which the run is then completed."""


@pytest.fixture
def network() -> Iterator[Network]:
    try:
        network = Network(["left", "right"])
    except NotPermittedError as error:
        pytest.skip(f"no network of namespaces on this machine: {error}")
    yield network
    network.close()


@pytest.fixture
def left(network: Network, tmp_path: Path) -> Iterator[Host]:
    """Return the host of the orchestrator."""
    host = Host(network, "left", tmp_path / "left")
    yield host
    host.kill()


@pytest.fixture
def right(network: Network, tmp_path: Path) -> Iterator[Host]:
    """Return the host whose cable is pulled."""
    host = Host(network, "right", tmp_path / "right")
    yield host
    host.kill()


def facts(observer: Started) -> list[dict[str, Any]]:
    """Return an observer's output; its last line may be incomplete."""
    return [json.loads(line) for line in observer.output.split("\n")[:-1] if line.startswith("{")]


def newest_generation(observer: Started) -> int:
    return max((f["generation"] for f in facts(observer) if "generation" in f), default=-1)


def wait_for_work_of(observer: Started, evaluator: str, after: int) -> None:
    """Wait for an evaluator's episode of a generation that began after another one."""

    def has_worked() -> bool:
        return any(
            f["episode_of"] == evaluator and f["generation"] > after
            for f in facts(observer)
            if "episode_of" in f
        )

    wait_until(has_worked, f"work of {evaluator} after generation {after}")


@pytest.mark.parametrize("seconds", [8.0, 30.0], ids=["8 s", "30 s, beyond the DDS lease"])
def test_a_pulled_cable_changes_nothing(
    network: Network, left: Host, right: Host, tmp_path: Path, seconds: float
) -> None:
    run_dir = tmp_path / "run"
    observer = left.launch([sys.executable, str(OBSERVER)])
    right.start("evaluator", {"task": "qd_walker"}, "-r", "__node:=far")
    run = left.run(run_dir, **LONG)
    wait_for_work_of(observer, "/far", after=0)

    network.pull_cable("right")
    pulled, before = time.monotonic(), newest_generation(observer)
    wait_until(lambda: time.monotonic() - pulled > seconds, "the end of the failure")
    without = newest_generation(observer)
    assert without > before + 1, "the run must continue without the far evaluator"
    network.plug_cable("right")
    wait_for_work_of(observer, "/far", after=without)

    run.signal(signal.SIGTERM)
    assert run.wait() == 0, run.output
    evaluations = evaluations_of(run_dir) + MORE
    again = left.run(run_dir, evaluations=evaluations)
    assert again.wait() == 0, again.output
    assert run_digest(run_dir) == search_digest(evaluations=evaluations)
