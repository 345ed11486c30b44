"""Protection of the services that rclpy gives every node: an unexpected request must not end the node.

For example, `set_parameters` with a value of unknown type raises in rclpy, which ends the executor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node

from pga_me_ros.ros.refusals import printable

Callback = Callable[[Any, Any], Any]

KNOWN_TYPES = range(ParameterType.PARAMETER_NOT_SET, ParameterType.PARAMETER_STRING_ARRAY + 1)


def shield(node: Node, refused: Callable[[str], None]) -> None:
    """Make rclpy's services of a node refuse what they cannot answer. Call it right after the node was made.

    Args:
        node: A node that has only rclpy's services so far.
        refused: Called with the reason of each refusal.
    """
    for service in node.services:
        service.callback = _shielded(service.srv_name, service.callback, refused)


def _shielded(name: str, callback: Callback, refused: Callable[[str], None]) -> Callback:
    def answer(request: Any, response: Any) -> Any:
        fresh = type(response)
        try:
            _require_sound(request)
            return callback(request, response)
        except Exception as error:  # anything that rclpy did not expect
            reason = printable(f"{type(error).__name__}: {error}")
            refused(f"refused a request to {name}: {reason}")
            return _refusal(fresh(), request, reason)

    return answer


def _require_sound(request: Any) -> None:
    """Refuse parameters of unknown type, or without a name, before the request has any effect.

    Raises:
        TypeError: A parameter has a type unknown to ROS 2.
        ValueError: A parameter has no name; rclpy would accept it.
    """
    if isinstance(request, (SetParameters.Request, SetParametersAtomically.Request)):
        for parameter in request.parameters:
            if not parameter.name:
                raise ValueError("a parameter has no name")
            if parameter.value.type not in KNOWN_TYPES:
                raise TypeError(
                    f"parameter '{parameter.name}' has type {parameter.value.type}; expected 0 to "
                    f"{KNOWN_TYPES[-1]} (rcl_interfaces/msg/ParameterType)"
                )


def _refusal(response: Any, request: Any, reason: str) -> Any:
    refusal = SetParametersResult(successful=False, reason=reason)
    if isinstance(response, SetParameters.Response):
        response.results = [refusal] * len(request.parameters)
    elif isinstance(response, SetParametersAtomically.Response):
        response.result = refusal
    return response
