"""What an adapter asks the repertoire, by the services that any robot may call."""

from __future__ import annotations

from typing import Any

import numpy as np
from pga_me_msgs.srv import GetBehavior
from rclpy.node import Node

from pga_me_ros.adapting.memory import Undertaking
from pga_me_ros.client import RepertoireClient, RepertoireInfo
from pga_me_ros.client.patient_caller import PatientCaller
from pga_me_ros.client.requests import behavior_request
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.errors import RequestError
from pga_me_ros.ros import names, qos

PAGE = 2000
"""Behaviors per answer while listing."""

TIMEOUT = 8.0
"""Seconds that an answer of the repertoire may take, discovery included."""


class RepertoireLink:
    """Blocking requests to the repertoire, through a node that nobody spins.

    Args:
        node: Such a node; it is spun while a request waits for its answer.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._client = RepertoireClient(node, timeout=TIMEOUT)
        self._caller = PatientCaller(node)
        self._behavior = node.create_client(
            GetBehavior,
            names.GET_BEHAVIOR,
            qos_profile=qos.CLIENT,
            callback_group=self._caller.group,
        )

    def info(self) -> RepertoireInfo:
        """Return what the repertoire is.

        Raises:
            RepertoireTimeoutError: Nobody serves one.
        """
        return self._client.get_info()

    def promises(self, undertaking: Undertaking) -> PerformanceMap:
        """Return what the repertoire promises now, without controllers.

        Args:
            undertaking: Limits to the behaviors that may be tried.

        Raises:
            RequestError: There is none, or a limit makes no sense.
            RepertoireTimeoutError: No answer came.
        """
        limits: dict[str, Any] = undertaking.limits
        behaviors = list(self._client.list_behaviors(page=PAGE, **limits))
        if limits and not behaviors:
            raise RequestError(
                f"No behavior of the repertoire meets {undertaking.limits_in_words}; ask for less."
            )
        info = self._client.get_info()
        dimensions = len(info.descriptor_low)
        descriptors = [b.promised_descriptor for b in behaviors]
        return PerformanceMap(
            cells=np.array([b.cell for b in behaviors], np.int64),
            evaluations=np.array([b.evaluation for b in behaviors], np.int64),
            descriptors=np.array(descriptors, np.float64).reshape(len(behaviors), dimensions),
            fitness=np.array([b.promised_fitness for b in behaviors], np.float64),
            low=np.array(info.descriptor_low),
            high=np.array(info.descriptor_high),
        )

    def behavior(self, cell: int, *, with_controller: bool) -> GetBehavior.Response:
        """Return the repertoire's answer about the behavior of a cell.

        Raises:
            RepertoireTimeoutError: No answer came.
        """
        request = behavior_request(cell=cell, with_controller=with_controller)
        answer: GetBehavior.Response = self._caller.call(
            self._behavior, request, lambda response: response, TIMEOUT
        )
        return answer
