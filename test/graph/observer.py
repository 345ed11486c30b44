"""A plain ROS node that prints messages of evaluators, one JSON line each; run as a program.

Like a node written by somebody else, it knows only the project's messages.
"""

from __future__ import annotations

import json
from typing import Any

import rclpy
from pga_me_msgs.msg import NodeStatus, Transitions
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile


def say(**facts: Any) -> None:
    print(json.dumps(facts), flush=True)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("observer")
    node.create_subscription(
        NodeStatus,
        "status",
        lambda m: say(alive=m.node, pid=m.pid, host=m.host, done=m.done),
        QoSProfile(depth=50),
    )
    node.create_subscription(
        Transitions,
        "experience/transitions",
        lambda m: say(episode_of=m.evaluator, generation=m.generation, evaluation=m.evaluation),
        QoSProfile(depth=50),
    )
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main()
