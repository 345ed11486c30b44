"""Saves the response of get_behavior as JSON: `python examples/save_response.py 0.9 0.1 > response.json`."""

import json
import sys
from typing import Any

import rclpy
from pga_me_msgs.srv import GetBehavior


def as_json(value: Any) -> Any:
    """Return a message, or what one of its fields holds, as dictionaries, lists, texts and numbers."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: as_json(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, str | bool | int | float):
        return value
    return [as_json(entry) for entry in value]


def main() -> None:
    """Ask for the gait nearest to the descriptor on the command line."""
    rclpy.init()
    node = rclpy.create_node("save_response")
    client = node.create_client(GetBehavior, "repertoire/get_behavior")
    if not client.wait_for_service(10.0):
        sys.exit("error: nobody serves repertoire/get_behavior")
    request = GetBehavior.Request(descriptor=[float(word) for word in sys.argv[1:]])
    answer = client.call_async(request)
    rclpy.spin_until_future_complete(node, answer, timeout_sec=10.0)
    if not answer.done():
        sys.exit("error: no answer within 10 s")
    json.dump(as_json(answer.result()), sys.stdout)


if __name__ == "__main__":
    main()
