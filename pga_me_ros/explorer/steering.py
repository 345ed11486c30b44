"""Pause, resume, stop and rates of a run, by the orchestrator's own services and parameters."""

from __future__ import annotations

import dataclasses
import threading
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import Trigger

from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.settings.rules import useless
from pga_me_ros.errors import RequestError

ACTIONS = ("pause", "resume", "stop")
"""What can be done to a run as a whole."""

TIMEOUT = 5.0
"""Seconds to wait for the orchestrator."""

ORCHESTRATOR = "orchestrator"


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
        self._set = node.create_client(SetParameters, f"{ORCHESTRATOR}/set_parameters")
        self.rates: list[dict[str, Any]] = []

    def carry_out(self, action: str, values: dict[str, Any]) -> str:
        """Do what the page asks for, and return what came of it.

        Args:
            action: One of `ACTIONS`, or ``rates`` to read them and to set those that are given.
            values: Numbers by the name of a rate.

        Raises:
            RequestError: The action is unknown, the orchestrator does not answer, or it refuses.
        """
        if action in ACTIONS:
            answer = self._call(self._triggers[action], Trigger.Request())
            return f"{action}: {answer.message}"
        if action != "rates":
            raise RequestError(
                f"There is no action '{action}'; give {', '.join(ACTIONS)} or rates."
            )
        said = self._set_rates(values) if values else ""
        self._read_rates()
        return said

    def _set_rates(self, values: dict[str, Any]) -> str:
        request = SetParameters.Request()
        fields = {f.name: f for f in dataclasses.fields(Settings)}
        for name, value in values.items():
            if name not in self._names:
                listed = ", ".join(self._names)
                raise RequestError(f"'{name}' is no rate of this run; these are: {listed}.")
            kind: Any = type(fields[name].default)
            try:
                number = kind(value)
            except (TypeError, ValueError):
                raise RequestError(f"{name} is '{value}'; give a number.") from None
            request.parameters.append(Parameter(name, value=number).to_parameter_msg())
        answer = self._call(self._set, request)
        refused = [result.reason for result in answer.results if not result.successful]
        if refused:
            raise RequestError(" ".join(refused))
        return "from the next generation on: " + ", ".join(f"{n} = {v}" for n, v in values.items())

    def _read_rates(self) -> None:
        answer = self._call(self._get, GetParameters.Request(names=self._names))
        fields = {f.name: f for f in dataclasses.fields(Settings)}
        self.rates = [
            {
                "name": name,
                "value": parameter_value_to_python(value),
                "description": fields[name].metadata["description"],
                "low": fields[name].metadata["low"],
                "high": fields[name].metadata["high"],
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
