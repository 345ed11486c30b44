"""The rates of a run, which its user may set from the first moment on."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.parameter import Parameter

from pga_me_ros.errors import SettingsError
from pga_me_ros.orchestration.control import Control


@pytest.fixture
def control(monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with domain_id() as domain:
        rclpy.init(args=[], domain_id=domain)
        control = Control()
        yield control
        control.destroy_node()
        rclpy.shutdown()


def test_rates_that_were_set_while_the_run_was_opened_are_in_force(control: Control) -> None:
    stored = dataclasses.replace(control.settings, iso_sigma=0.25)
    (result,) = control.set_parameters([Parameter("n_evo", value=80)])
    assert result.successful
    control.take_rates(stored)
    assert (control.settings.n_evo, control.settings.iso_sigma) == (80, 0.25)
    for name, value in (("n_evo", 80), ("iso_sigma", 0.25)):
        assert control.get_parameter(name).value == value


def test_rates_that_do_not_fit_those_of_the_run_end_it(control: Control) -> None:
    control.set_parameters([Parameter("n_evo", value=80)])
    with pytest.raises(SettingsError, match="n_evo"):
        control.take_rates(dataclasses.replace(control.settings, n_evo=10, batch_size=60))
