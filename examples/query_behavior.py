"""A robot's node that requests a gait by its descriptor, then runs it. `python examples/query_behavior.py 0.9 0.1`."""

import sys
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray

from pga_me_ros.client import Behavior, RepertoireClient


class Robot(Node):
    """Runs one gait."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.behavior: Behavior | None = None
        self.actions = self.create_publisher(Float32MultiArray, "actions", 1)
        self.create_subscription(Float32MultiArray, "observations", self.act, 1)

    def act(self, observation: Float32MultiArray) -> None:
        """Answer an observation with an action."""
        if self.behavior and self.context.ok():
            action = self.behavior.controller(observation.data)
            self.actions.publish(Float32MultiArray(data=action.tolist()))


rclpy.init()
with suppress(KeyboardInterrupt, ExternalShutdownException):
    robot = Robot()
    try:
        wanted = [float(word) for word in sys.argv[1:]]
        robot.behavior = RepertoireClient(robot).get_behavior(descriptor=wanted)
    except ValueError as error:  # no number; or a PgaError: no such gait, or nobody answered
        sys.exit(f"error: {error}")
    print(
        f"fitness {robot.behavior.fitness:.1f}, descriptor {robot.behavior.descriptor}", flush=True
    )
    rclpy.spin(robot)
