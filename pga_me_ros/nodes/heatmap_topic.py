"""The archive as pictures on topics, each drawn only while somebody looks at it."""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Image

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.heatmap import render
from pga_me_ros.core.occupancy import FitnessMap
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import image_to_msg
from pga_me_ros.ros.spinning import EndingNode

PERIOD = 0.5
"""Seconds between two looks at whether a picture is wanted: a run may finish several generations in a second."""

WIDTH = 240
"""Pixels; the first picture of a Voronoi archive this wide takes a quarter of a second, each later one milliseconds."""

FRAME = "repertoire"
"""Frame of the map: its x is the first descriptor, its y the second, in descriptor units."""

Draw = Callable[[Archive, Time], Any]


class ArchivePictures:
    """Publishes pictures of an archive, latched: `repertoire/heatmap`, and `repertoire/grid` of two dimensions.

    Args:
        node: Node that publishes them.
        archive: The archive; tell by `changed` when it is another one or has other elites.
    """

    def __init__(self, node: EndingNode, archive: Archive) -> None:
        self._node = node
        self._archive = archive
        self._pictures = [_Picture(node, Image, names.HEATMAP, _heatmap)]
        if archive.dimensions == 2:
            shown = FitnessMap(archive, WIDTH)

            def draw(archive: Archive, stamp: Time) -> OccupancyGrid:
                return map_to_msg(shown, archive, stamp)

            self._pictures.append(_Picture(node, OccupancyGrid, names.GRID, draw))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD, node.unless_ended(self._look), clock=steady)

    def changed(self, archive: Archive) -> None:
        """Say that the pictures are out of date."""
        self._archive = archive
        for picture in self._pictures:
            picture.newest = None

    def _look(self) -> None:
        for picture in self._pictures:
            picture.look(self._archive, self._node)


class _Picture:
    """One picture on its topic.

    Attributes:
        newest: The picture, None when it has to be drawn anew.
    """

    def __init__(self, node: Node, kind: type, name: str, draw: Draw) -> None:
        self.newest: Any = None
        self._draw = draw
        self._watchers = 0
        self._topic = node.create_publisher(kind, name, qos.LATCHED)

    def look(self, archive: Archive, node: Node) -> None:
        """Draw and publish it if somebody is there who has not got it."""
        before, self._watchers = self._watchers, self._topic.get_subscription_count()
        # Someone new gets the picture even if it is not new: their subscription may not be latched.
        if self._watchers and (self.newest is None or self._watchers > before):
            if self.newest is None:
                self.newest = self._draw(archive, node.get_clock().now().to_msg())
            self._topic.publish(self.newest)


def _heatmap(archive: Archive, stamp: Time) -> Image:
    return image_to_msg(render(archive, WIDTH), stamp)


def map_to_msg(shown: FitnessMap, archive: Archive, stamp: Time) -> OccupancyGrid:
    """Return an archive's fitness as a map, row by row from the lower left: 0 to 100, -1 where there is no elite."""
    msg = OccupancyGrid()
    msg.header.stamp = msg.info.map_load_time = stamp
    msg.header.frame_id = FRAME
    msg.info.resolution = shown.resolution
    msg.info.width, msg.info.height = shown.columns, shown.rows
    msg.info.origin.position.x, msg.info.origin.position.y = shown.origin
    msg.data = array.array("b", shown.values(archive).tobytes())
    return msg
