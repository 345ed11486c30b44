"""Real nodes in real processes, each test in a ROS domain of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from domain_coordinator import domain_id
from graph import Graph, Probe
from stored import Served, served

EXACT = ("test_chaos", "test_determinism", "test_recovery", "test_fuzz", "test_stray_snapshots")
"""Tests of what must hold every single time."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give tests of processes a second chance: a machine that stalls can pass any deadline, and discovery has none.

    Not where the result of a run is at stake: a wrong repertoire fails at once. Tests of minutes wait to be asked.
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
    """A small finished repertoire that an archive manager serves to all tests of a file."""
    with served(tmp_path_factory.mktemp("served")) as repertoire:
        yield repertoire


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Start nodes in a private ROS domain; whatever is left of them is killed at the end."""
    with domain_id() as domain:
        graph = Graph(domain, tmp_path)
        yield graph
        graph.kill()


@pytest.fixture
def probe(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> Iterator[Probe]:
    """A node of this process in the same domain, to call services and listen to topics with."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    probe = Probe(graph.domain)
    yield probe
    probe.close()
