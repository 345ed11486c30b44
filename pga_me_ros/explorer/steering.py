"""Pause, resume, stop and rates of a run, by the orchestrator's own services and parameters."""

from __future__ import annotations

import dataclasses
import threading
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import Trigger

from pga_me_ros.arguments import number, whole_number
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.settings.rules import useless
from pga_me_ros.errors import RequestError

ACTIONS = ("pause", "resume", "stop")
"""What can be done to a run as a whole."""

TIMEOUT = 5.0
"""Seconds to wait for the orchestrator."""

ORCHESTRATOR = "orchestrator"

FIELDS = {f.name: f for f in dataclasses.fields(Settings)}
"""What is known of each setting."""


def _is_whole(name: str) -> bool:
    """Whether a rate is a whole number."""
    return isinstance(FIELDS[name].default, int)


class Steering:
    """Calls the orchestrator; another thread spins the node.

    Args:
        node: Node to call through.
        settings: Settings of the run, which say what rates it has.

    Attributes:
        rates: The rates in force, with description and range, as they were last read; empty before.
    """

    def __init__(self, node: Node, settings: Settings) -> None:
        unused = useless(RATES, settings.algorithm, settings.archive)
        self._names = [name for name in RATES if name not in unused]
        self._triggers = {
            name: node.create_client(Trigger, f"{ORCHESTRATOR}/{name}") for name in ACTIONS
        }
        self._get = node.create_client(GetParameters, f"{ORCHESTRATOR}/get_parameters")
        self._set = node.create_client(
            SetParametersAtomically, f"{ORCHESTRATOR}/set_parameters_atomically"
        )
        self.rates: list[dict[str, Any]] = []

    def carry_out(self, action: str, values: dict[str, Any]) -> str:
        """Do what the page asks for, and return what came of it.

        Args:
            action: One of `ACTIONS`, or ``rates`` to read them and to set those that are given.
            values: Numbers by the name of a rate.

        Raises:
            RequestError: The action is unknown, a value is no number, the orchestrator does not answer, or it refuses.
        """
        if action in ACTIONS:
            answer = self._call(self._triggers[action], Trigger.Request())
            return f"{action}: {answer.message}"
        if action != "rates":
            raise RequestError(
                f"There is no action '{action}'; give {', '.join(ACTIONS)} or rates."
            )
        rates = self._checked(values)
        try:
            if rates:
                self._set_rates(rates)
        finally:
            self._read_rates()  # after a refusal, too: the page shows what is in force
        listed = ", ".join(f"{name} = {value}" for name, value in rates.items())
        return f"from the next generation on: {listed}" if rates else ""

    def _checked(self, values: dict[str, Any]) -> dict[str, int | float]:
        """Return rates in the type that they have.

        Raises:
            RequestError: There is no such rate, or a value is no number of its type.
        """
        unknown = next((name for name in values if name not in self._names), None)
        if unknown is not None:
            listed = ", ".join(self._names)
            raise RequestError(f"'{unknown}' is no rate of this run; these are: {listed}.")
        return {
            name: whole_number(name, value) if _is_whole(name) else number(name, value)
            for name, value in values.items()
        }

    def _set_rates(self, rates: dict[str, int | float]) -> None:
        """Set all of them or none.

        Raises:
            RequestError: The orchestrator refuses, or does not answer.
        """
        parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in rates.items()]
        request = SetParametersAtomically.Request(parameters=parameters)
        result = self._call(self._set, request).result
        if not result.successful:
            raise RequestError(result.reason)

    def _read_rates(self) -> None:
        answer = self._call(self._get, GetParameters.Request(names=self._names))
        self.rates = [
            {
                "name": name,
                "value": parameter_value_to_python(value),
                "whole": _is_whole(name),
                "description": FIELDS[name].metadata["description"],
                "low": FIELDS[name].metadata["low"],
                "high": FIELDS[name].metadata["high"],
            }
            for name, value in zip(self._names, answer.values, strict=True)
        ]

    def _call(self, client: Client, request: Any) -> Any:
        """Return a service's answer.

        Raises:
            RequestError: There is none in time.
        """
        if not client.wait_for_service(TIMEOUT):
            raise RequestError("The orchestrator does not answer; no run is under way here.")
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        if not done.wait(TIMEOUT):
            client.remove_pending_request(future)
            raise RequestError("The orchestrator has not answered in time; try again.")
        return future.result()
