"""A robot's node that adapts: it tries what the adapter gives it, and says what came of it.

::

    result = Adapter(node).adapt(try_behavior)  # try_behavior(behavior) runs it and returns its fitness
    print(result.adapted, result.behavior)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pga_me_msgs.msg import AdaptationEstimate
from pga_me_msgs.srv import GetAdaptation, NextTrial, ReportTrial, StartAdaptation
from rclpy.client import Client
from rclpy.node import Node

from pga_me_ros.arguments import number, share, whole_number
from pga_me_ros.client.behaviors import Behavior
from pga_me_ros.client.patient_caller import PatientCaller
from pga_me_ros.client.requests import checked_timeout, in_namespace
from pga_me_ros.errors import RequestError
from pga_me_ros.ros import names, qos

TIMEOUT = 30.0
"""Seconds; the adapter may have to list the repertoire first."""


@dataclass(frozen=True)
class AdaptationResult:
    """What an adaptation came to.

    Attributes:
        adapted: Whether the best trial achieved what is to be expected; otherwise the budget was spent.
        behavior: The behavior of the best trial, None if no trial was reported or the repertoire has it no longer.
        achieved: Its fitness, NaN for none.
        trials: Number of trials.
    """

    adapted: bool
    behavior: Behavior | None
    achieved: float
    trials: int


class Adapter:
    """Asks the node ``adapter`` for behaviors to try.

    Its methods block; they work where those of `RepertoireClient` do.

    Args:
        node: Node to ask through.
        prefix: Namespace of the adapter; empty for the node's own.
        timeout: Seconds after which a call fails.

    Raises:
        RequestError: The timeout makes no sense.
        SettingsError: The prefix is no valid namespace.
    """

    def __init__(self, node: Node, prefix: str = "", timeout: float = TIMEOUT) -> None:
        self._node, self._prefix, self._timeout = node, prefix, checked_timeout(timeout)
        self._caller = PatientCaller(node, "an adapter")
        self._start = self._client(StartAdaptation, names.START_ADAPTATION)
        self._next = self._client(NextTrial, names.NEXT_TRIAL)
        self._report = self._client(ReportTrial, names.REPORT_TRIAL)
        self._status = self._client(GetAdaptation, names.ADAPTATION_STATUS)

    def adapt(
        self,
        try_behavior: Callable[[Behavior], float | None],
        *,
        budget: int | None = None,
        anew: bool = False,
        min_fitness: float | None = None,
        max_fall_share: float | None = None,
    ) -> AdaptationResult:
        """Try behaviors until one works well enough, or the budget is spent.

        An adaptation that was interrupted is continued, its open trial first.

        Args:
            try_behavior: Runs a behavior on the robot and returns its fitness, on the scale of the repertoire; None or
                NaN gives the trial up.
            budget: Most trials, None for the adapter's own.
            anew: Whether to forget an adaptation that is under way.
            min_fitness: Least fitness that a behavior must promise, None for any.
            max_fall_share: Greatest share of its re-evaluations that ended in a fall, None for any.

        Raises:
            RequestError: The adapter refused a request; the message says why.
            RepertoireTimeoutError: No answer before the deadline.
            BlockedExecutorError: Called in a callback of the node's executor.
        """
        start = StartAdaptation.Request(anew=bool(anew))
        if budget is not None:
            start.budget = whole_number("budget", budget)
            if start.budget < 1:
                raise RequestError(f"budget is {budget}; give at least 1 trial.")
        if min_fitness is not None:
            start.min_fitness = number("min_fitness", min_fitness)
        if max_fall_share is not None:
            start.max_fall_share = share("max_fall_share", max_fall_share)
        made = self._call(self._start, start).trials
        while True:
            answer = self._call(self._next, NextTrial.Request())
            if answer.over:
                return _result(answer, made)
            achieved = try_behavior(Behavior.of(answer.behavior, answer.controller))
            lost = achieved is None or math.isnan(achieved)
            report = ReportTrial.Request(trial=answer.trial.number, give_up=lost)
            if achieved is not None and not lost:
                report.fitness = float(achieved)
            self._call(self._report, report)
            made = int(answer.trial.number)

    def status(self) -> AdaptationEstimate:
        """Return what is expected of each behavior now, how uncertain that is, and all trials.

        Raises:
            RequestError: The adapter refused the request; the message says why.
            RepertoireTimeoutError: No answer before the deadline.
            BlockedExecutorError: Called in a callback of the node's executor.
        """
        estimate: AdaptationEstimate = self._call(self._status, GetAdaptation.Request()).estimate
        return estimate

    @property
    def clients(self) -> tuple[Client, ...]:
        """The clients of the adapter's services."""
        return self._start, self._next, self._report, self._status

    def close(self) -> None:
        """Destroy the clients; only while the node is not spun."""
        self._caller.close()
        for client in self.clients:
            self._node.destroy_client(client)

    def _client(self, srv_type: Any, name: str) -> Any:
        full = in_namespace(self._prefix, name)
        return self._node.create_client(
            srv_type, full, qos_profile=qos.CLIENT, callback_group=self._caller.group
        )

    def _call(self, client: Any, request: Any) -> Any:
        return self._caller.call(client, request, _accepted, self._timeout)


def _result(answer: NextTrial.Response, made: int) -> AdaptationResult:
    """Return what an adaptation came to, after so many trials."""
    has_controller = bool(answer.controller.layer_sizes)
    behavior = Behavior.of(answer.behavior, answer.controller) if has_controller else None
    achieved = answer.trial.achieved if answer.trial.number else math.nan
    return AdaptationResult(answer.adapted, behavior, achieved, made)


def _accepted(response: Any) -> Any:
    """Return an answer.

    Raises:
        RequestError: The request was refused.
    """
    if not response.ok:
        raise RequestError(response.message)
    return response
