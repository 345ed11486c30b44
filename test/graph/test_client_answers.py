"""The client that robots import: its answers, what it refuses, and the example that uses it."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from graph import wait_until
from std_msgs.msg import Float32MultiArray
from stored import Served

from pga_me_ros.client import BehaviorNotFoundError, RepertoireClient
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import RequestError


@pytest.fixture
def client(repertoire: Served) -> RepertoireClient:
    return RepertoireClient(repertoire.probe.node)


def test_not_found_errors_have_a_reason(client: RepertoireClient) -> None:
    with pytest.raises(BehaviorNotFoundError, match=r"No behavior has a fitness of 1000000\.0"):
        client.get_behavior(descriptor=[0.5, 0.5], min_fitness=1e6)


def test_a_descriptor_of_the_wrong_length_is_reported(client: RepertoireClient) -> None:
    with pytest.raises(BehaviorNotFoundError, match="has 3 entries; this repertoire's has 2"):
        client.get_behavior(descriptor=[0.5, 0.5, 0.5])


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ({}, "exactly one of.*given: none"),
        ({"best": True, "cell": 3}, "given: cell, best"),
        ({"descriptor": [0.5, float("nan")]}, "descriptor is or holds nan"),
        ({"descriptor": ["left"]}, "descriptor is or holds 'left'"),
        ({"best": True, "max_distance": 1.0}, "together with a descriptor"),
        ({"descriptor": [0.5, 0.5], "max_distance": -1.0}, "max_distance is -1.0"),
        ({"best": True, "min_fitness": float("nan")}, "min_fitness is or holds nan"),
        ({"best": True, "timeout": 0.0}, "timeout is 0.0"),
    ],
)
def test_invalid_arguments_are_refused_at_once(
    client: RepertoireClient, wanted: dict[str, Any], words: str
) -> None:
    with pytest.raises(RequestError, match=words):
        client.get_behavior_async(**wanted)


def test_all_are_listed_page_by_page(repertoire: Served, client: RepertoireClient) -> None:
    archive = repertoire.archive
    fittest_first = sorted(archive.filled_cells(), key=lambda cell: -archive.fitness[cell])
    assert [b.cell for b in client.list_behaviors(page=5)] == fittest_first


def test_a_page_that_is_too_long_is_refused(client: RepertoireClient) -> None:
    with pytest.raises(RequestError, match="limit 10001; expected offset from 0 on"):
        list(client.list_behaviors(page=10_001))


def test_generations_are_listed_page_by_page(repertoire: Served, client: RepertoireClient) -> None:
    listed = list(client.list_generations(page=1))
    with Repertoire.open(repertoire.path, read_only=True) as file:
        for found, stored in zip(listed, file.metrics(), strict=True):
            for name in ("generation", "evaluations", "coverage", "qd_score", "steps"):
                assert getattr(found, name) == getattr(stored, name)
            assert found.offspring == {"random": 10}
            assert sum(found.new_elites.values()) == sum(stored.new_elites)
            assert sum(found.improved_elites.values()) == sum(stored.improved_elites)
            assert found.corrected == {}
    assert list(client.list_generations(1)) == listed[1:]
    assert list(client.list_generations(7)) == []


@pytest.mark.parametrize(("first", "page"), [(-1, 10), (0, 0), (0, 1001)])
def test_generations_that_cannot_be_are_refused(
    client: RepertoireClient, first: int, page: int
) -> None:
    with pytest.raises(RequestError, match=f"first is {first} and limit {page}; expected"):
        list(client.list_generations(first, page=page))


def test_info_describes_the_descriptor(client: RepertoireClient) -> None:
    info = client.get_info()
    assert (info.task, info.settings["seed"], info.coverage, info.evaluations) == (
        "qd_walker",
        3,
        16,
        20,
    )
    assert len(info.descriptor_names) == len(info.descriptor_high) == 2


def test_the_example_finds_a_gait_and_acts(repertoire: Served) -> None:
    example = Path(__file__).resolve().parents[2] / "examples" / "query_behavior.py"

    robot = repertoire.graph.launch([sys.executable, str(example), "0.9", "0.1"])
    robot.wait_for_output("descriptor")
    heard = repertoire.probe.listen(Float32MultiArray, "actions", 1)
    publisher = repertoire.probe.node.create_publisher(Float32MultiArray, "observations", 1)

    def acted() -> bool:
        publisher.publish(Float32MultiArray(data=[0.1] * 22))
        return bool(heard)

    wait_until(acted, "an action")
    robot.signal(signal.SIGINT)
    assert (robot.wait(), len(heard[0].data)) == (0, 6)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["0.9"], "error: The descriptor has 1 entries; this repertoire's has 2"),
        (["0.9", "high"], "error: could not convert string to float: 'high'"),
    ],
)
def test_the_example_ends_with_the_reason_if_there_is_no_gait(
    repertoire: Served, words: list[str], reason: str
) -> None:
    example = Path(__file__).resolve().parents[2] / "examples" / "query_behavior.py"
    robot = repertoire.graph.launch([sys.executable, str(example), *words])
    assert robot.wait() == 1, robot.output
    assert reason in robot.output
    assert "Traceback" not in robot.output
    assert "Unhandled" not in robot.output
