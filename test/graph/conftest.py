"""Real nodes in real processes, each test in its own ROS domain."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from domain_coordinator import domain_id
from graph import Graph, Probe
from stored import Served, served

EXACT = ("test_chaos", "test_determinism", "test_recovery", "test_fuzz", "test_stray_snapshots")
"""Tests that must pass every time."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give tests of processes a second chance: a machine that stalls can miss any deadline, and discovery has no bound.

    Tests of a run's result get none: a wrong repertoire fails at once. Tests that take minutes run only on request.
    """
    here = Path(__file__).parent
    asked = config.getoption("markexpr")
    for item in items:
        if item.get_closest_marker("two_hosts") and "two_hosts" not in asked:
            item.add_marker(pytest.mark.skip(reason="takes minutes: make two-hosts"))
        if here in item.path.parents and item.path.stem not in EXACT:
            item.add_marker(pytest.mark.flaky(reruns=2))


@pytest.fixture(scope="module")
def repertoire(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Serve a small finished repertoire to all tests of a file."""
    with served(tmp_path_factory.mktemp("served")) as repertoire:
        yield repertoire


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Start nodes in a private ROS domain; those that are left at the end are killed."""
    with domain_id() as domain:
        graph = Graph(domain, tmp_path)
        yield graph
        graph.kill()


@pytest.fixture
def probe(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> Iterator[Probe]:
    """Return a node of this process in the same domain, to call services and subscribe to topics."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    probe = Probe(graph.domain)
    yield probe
    probe.close()
