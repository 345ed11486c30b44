"""Rates that the page sets: as they were typed, all or none, on a real orchestrator's parameters."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.executors import SingleThreadedExecutor

from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import RequestError
from pga_me_ros.explorer.steering import Steering
from pga_me_ros.orchestration.control import Control

WORDS = ["-p", "n_evo:=40", "-p", "iso_sigma:=0.01"]


@pytest.fixture
def orchestrator(monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    """Return the node whose parameters are the rates; another thread spins it and the page's node."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with domain_id() as domain:
        rclpy.init(args=["node", "--ros-args", *WORDS], domain_id=domain)
        control = Control()
        executor = SingleThreadedExecutor()
        executor.add_node(control)
        spinning = threading.Thread(target=executor.spin)
        spinning.start()
        control.executor = executor
        yield control
        executor.shutdown()
        spinning.join()
        rclpy.shutdown()


@pytest.fixture
def steering(orchestrator: Control) -> Iterator[Steering]:
    node = rclpy.create_node("page")
    orchestrator.executor.add_node(node)
    yield Steering(node, orchestrator.settings)
    node.destroy_node()


def rates(steering: Steering) -> dict[str, Any]:
    return {rate["name"]: rate["value"] for rate in steering.rates}


def test_what_is_told_is_what_was_set(steering: Steering, orchestrator: Control) -> None:
    said = steering.carry_out("rates", {"n_evo": 80.0, "iso_sigma": 1})
    assert said == "from the next generation on: n_evo = 80, iso_sigma = 1.0"
    assert (orchestrator.settings.n_evo, orchestrator.settings.iso_sigma) == (80, 1.0)
    assert (rates(steering)["n_evo"], rates(steering)["iso_sigma"]) == (80, 1.0)
    whole = {rate["name"] for rate in steering.rates if rate["whole"]}
    assert {"n_evo", "n_grad"} < whole
    assert "iso_sigma" not in whole


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ('{"n_evo": 80.7}', "n_evo is 80.7; give a whole number"),
        ('{"n_evo": Infinity}', "n_evo is inf; give a whole number"),
        ('{"n_evo": ""}', "n_evo is ''; give a whole number"),
        ('{"iso_sigma": null}', "iso_sigma is or holds None; give a number"),
        ('{"seed": 1}', "'seed' is no rate of this run"),
    ],
)
def test_what_is_no_number_of_its_kind_is_refused(
    steering: Steering, values: str, why: str
) -> None:
    with pytest.raises(RequestError, match=why):
        steering.carry_out("rates", json.loads(values))


def test_all_rates_are_set_or_none_and_then_read_again(
    steering: Steering, orchestrator: Control
) -> None:
    with pytest.raises(RequestError, match="iso_sigma"):
        steering.carry_out("rates", {"n_evo": 80, "iso_sigma": -1.0})
    assert isinstance(orchestrator.settings, Settings)
    assert (orchestrator.settings.n_evo, orchestrator.settings.iso_sigma) == (40, 0.01)
    assert (rates(steering)["n_evo"], rates(steering)["iso_sigma"]) == (40, 0.01)
