"""The archive as a picture on a topic, drawn only while somebody looks at it."""

from __future__ import annotations

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Image

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.heatmap import render
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import image_to_msg

PERIOD = 0.5
"""Seconds between two looks at whether a picture is wanted: a run may finish several generations in a second."""

WIDTH = 240
"""Pixels; the first picture of a Voronoi archive this wide takes a quarter of a second, each later one milliseconds."""


class HeatmapTopic:
    """Publishes a picture of an archive (`repertoire/heatmap`, latched).

    Args:
        node: Node that publishes it.
        archive: The archive; tell by `changed` when it is another one or has other elites.
    """

    def __init__(self, node: Node, archive: Archive) -> None:
        self._node = node
        self._archive = archive
        self._picture: Image | None = None
        self._watchers = 0
        self._topic = node.create_publisher(Image, names.HEATMAP, qos.LATCHED)
        node.create_timer(PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def changed(self, archive: Archive) -> None:
        """Say that the picture is out of date."""
        self._archive = archive
        self._picture = None

    def _look(self) -> None:
        before, self._watchers = self._watchers, self._topic.get_subscription_count()
        # Someone new gets the picture even if it is not new: their subscription may not be latched.
        if self._watchers and (self._picture is None or self._watchers > before):
            if self._picture is None:
                stamp = self._node.get_clock().now().to_msg()
                self._picture = image_to_msg(render(self._archive, WIDTH), stamp)
            self._topic.publish(self._picture)
