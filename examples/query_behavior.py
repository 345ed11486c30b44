"""A robot's node that requests a gait by its descriptor, then runs it. `python examples/query_behavior.py 0.9 0.1`."""

import sys
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float32MultiArray

from pga_me_ros.client import Behavior, RepertoireClient


class Robot(Node):
    """Runs one gait."""

    def __init__(self, wanted: list[float]) -> None:
        super().__init__("robot")
        self.behavior: Behavior | None = None
        self.actions = self.create_publisher(Float32MultiArray, "actions", 1)
        self.create_subscription(Float32MultiArray, "observations", self.act, 1)
        RepertoireClient(self).get_behavior_async(descriptor=wanted).add_done_callback(self.begin)

    def begin(self, answer: Future) -> None:
        """Receive the gait."""
        self.behavior = answer.result()  # raises if none was found, or nobody answered
        print(f"fitness {self.behavior.fitness:.1f}, descriptor {self.behavior.descriptor}")

    def act(self, observation: Float32MultiArray) -> None:
        """Answer an observation with an action."""
        if self.behavior and self.context.ok():
            action = self.behavior.controller(observation.data)
            self.actions.publish(Float32MultiArray(data=action.tolist()))


rclpy.init()
with suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(Robot([float(x) for x in sys.argv[1:]]))
