"""Pictures of the archive on topics, each drawn only while it has subscribers."""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Image

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.fitness_map import FitnessMap
from pga_me_ros.core.archive.heatmap import draw_heatmap
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import image_to_msg
from pga_me_ros.ros.spinning import EndingNode

PERIOD = 0.5
"""Seconds between two checks for subscribers; a run may finish several generations in a second."""

WIDTH = 240
"""Width in pixels; the first picture of a Voronoi archive takes a quarter of a second, each later one milliseconds."""

FRAME = "repertoire"
"""Frame of the map: its x is the first descriptor, its y the second, in descriptor units."""

Draw = Callable[[Archive, Time], Any]


class ArchivePictures:
    """Publishes pictures of an archive, latched: `repertoire/heatmap`, and for two dimensions `repertoire/grid`.

    A picture that cannot be drawn is reported once and left out; it never stops the node.

    Args:
        node: Node that publishes them.
        archive: The archive; call `changed` when its elites change or another archive replaces it.
    """

    def __init__(self, node: EndingNode, archive: Archive) -> None:
        self._node = node
        self._archive = archive
        self._pictures = [_Picture(node, Image, names.HEATMAP, _heatmap)]
        if archive.dimensions == 2:
            self._pictures.append(_Picture(node, OccupancyGrid, names.GRID, _Map(archive)))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD, node.unless_ended(self._look), clock=steady)

    def changed(self, archive: Archive) -> None:
        """Mark the pictures as out of date.

        Args:
            archive: The archive to draw from now on.
        """
        self._archive = archive
        for picture in self._pictures:
            picture.newest = None

    def _look(self) -> None:
        for picture in self._pictures:
            picture.look(self._archive, self._node)


class _Picture:
    """One picture on its topic.

    Attributes:
        newest: The current picture, None if it has to be redrawn.
    """

    def __init__(self, node: Node, kind: type, name: str, draw: Draw) -> None:
        self.newest: Any = None
        self._draw = draw
        self._name = name
        self._cannot = False
        self._watchers = 0
        self._topic = node.create_publisher(kind, name, qos.LATCHED)

    def look(self, archive: Archive, node: Node) -> None:
        """Draw and publish the picture if a subscriber may lack it."""
        before, self._watchers = self._watchers, self._topic.get_subscription_count()
        # A new subscriber gets the picture even if it is unchanged: the subscription may not be latched.
        if not self._watchers or self._cannot:
            return
        if self.newest is None or self._watchers > before:
            try:
                if self.newest is None:
                    self.newest = self._draw(archive, node.get_clock().now().to_msg())
                self._topic.publish(self.newest)
            except Exception as error:  # a picture must never stop a run, whatever the error
                self._cannot = True
                node.get_logger().warning(
                    f"{self._name} cannot be drawn and is left out: {type(error).__name__}: {error}"
                )


class _Map:
    """Draws the map; the layout of the cells is computed once, on first use."""

    def __init__(self, archive: Archive) -> None:
        self._cells = archive
        self._shown: FitnessMap | None = None

    def __call__(self, archive: Archive, stamp: Time) -> OccupancyGrid:
        if self._shown is None:
            self._shown = FitnessMap(self._cells, WIDTH)
        return map_to_msg(self._shown, archive, stamp)


def _heatmap(archive: Archive, stamp: Time) -> Image:
    return image_to_msg(draw_heatmap(archive, WIDTH), stamp)


def map_to_msg(shown: FitnessMap, archive: Archive, stamp: Time) -> OccupancyGrid:
    """Return an archive's fitness as a map, row by row from the lower left: 0 to 100, -1 for an empty cell."""
    msg = OccupancyGrid()
    msg.header.stamp = msg.info.map_load_time = stamp
    msg.header.frame_id = FRAME
    msg.info.resolution = shown.resolution
    msg.info.width, msg.info.height = shown.columns, shown.rows
    msg.info.origin.position.x, msg.info.origin.position.y = shown.origin
    msg.data = array.array("b", shown.values(archive).tobytes())
    return msg
