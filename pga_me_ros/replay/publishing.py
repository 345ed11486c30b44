"""Publishes recorded messages again, in their order and at their original speed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
from pga_me_msgs.msg import Metrics, Progress, Transitions
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.errors import RequestError
from pga_me_ros.recording.bag import read_bag, topics
from pga_me_ros.recording.definitions import type_name
from pga_me_ros.ros import qos
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.spinning import EndingNode

OFFERED: dict[str, tuple[type, QoSProfile]] = {
    type_name(Transitions): (Transitions, qos.EXPERIENCE_READER),
    type_name(Metrics): (Metrics, qos.LATCHED),
    type_name(Progress): (Progress, qos.LATCHED),
}
"""Types that are published, with their quality of service: experience in a queue as deep as the trainer's."""

LOOK = 0.02
"""Seconds between two checks for a subscriber: the node is not spun, so no event tells."""

BURST = 1000
"""Messages that are published before waiting for acknowledgment, which takes a second; a writer's queue is longer."""

LINGER = 10.0
"""Seconds that subscribers get to take the last messages."""

PROGRAM = Program("replay", "Publishes recorded messages again.", ())


def publish(bag: Path, rate: float, wait: float, ros_args: Sequence[str]) -> str:
    """Publish a recording's messages, byte for byte, on the topics that they came from.

    Args:
        bag: The recording.
        rate: Speed relative to the recording; 0 for no pauses.
        wait: Maximum seconds to wait for a subscriber, if the recording has experience.
        ros_args: ``--ros-args`` and what follows, for example to remap topics.

    Returns:
        What was published, as text.

    Raises:
        StorageError: The bag is not a recording, or damaged.
        RequestError: A number is negative, or there is nothing to publish.
        SettingsError: A ROS argument is invalid.
    """
    if not (0 <= rate < float("inf") and 0 <= wait < float("inf")):
        raise RequestError(f"--rate is {rate} and --wait {wait}; give 0 or more.")
    known = {topic: kind for topic, kind in topics(bag).items() if kind in OFFERED}
    if not known:
        raise RequestError(
            f"'{bag}' holds none of the types that `record` records: {', '.join(OFFERED)}."
        )
    start(PROGRAM, ros_args, signal_handler_options=SignalHandlerOptions.NO)
    node = EndingNode("replay")
    try:
        publishers = {
            topic: node.create_publisher(OFFERED[kind][0], topic, OFFERED[kind][1])
            for topic, kind in known.items()
        }
        _await_listener(
            [publishers[t] for t, k in known.items() if k == type_name(Transitions)], wait
        )
        count, seconds = _publish_all(bag, publishers, rate)
        for publisher in publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=LINGER))
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return f"published {count} messages in {seconds:.1f} s on {', '.join(known)}"


def _await_listener(publishers: Sequence[Publisher], wait: float) -> None:
    latest = time.monotonic() + wait
    while publishers and time.monotonic() < latest:
        if any(publisher.get_subscription_count() for publisher in publishers):
            return
        time.sleep(LOOK)


def _publish_all(bag: Path, publishers: dict[str, Publisher], rate: float) -> tuple[int, float]:
    """Return the number of messages published and the seconds it took."""
    began, first, count = time.monotonic(), 0, 0
    for message in read_bag(bag, OFFERED):
        first = first or message.time
        if rate:
            due = began + 1e-9 * (message.time - first) / rate
            time.sleep(max(0.0, due - time.monotonic()))
        publishers[message.topic].publish(message.data)
        count += 1
        if count % BURST == 0:
            # Without pauses, the next ones would displace these in the queue before they are sent.
            publishers[message.topic].wait_for_all_acked(Duration(seconds=LINGER))
    return count, time.monotonic() - began
