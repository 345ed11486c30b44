"""Records experience, metrics and progress of a run as bytes into a rosbag2 folder, until it is told to stop."""

from __future__ import annotations

import signal
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path

import rclpy
from pga_me_msgs.msg import Metrics, Progress, Transitions
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.errors import RequestError
from pga_me_ros.process.streams import tell
from pga_me_ros.recording.bag import BagWriter
from pga_me_ros.recording.definitions import type_name
from pga_me_ros.recording.gaps import SeenEpisodes, ranges
from pga_me_ros.recording.message_heads import committed_evaluations, episode_head
from pga_me_ros.recording.settings import RecorderSettings
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import report
from pga_me_ros.ros.refusals import printable
from pga_me_ros.ros.shield import shield

TICK = 0.1
"""Seconds between two checks whether to stop, if no message comes."""

QUIET_SECONDS = 0.3
"""Seconds without a message, after it was told to stop, until everything sent counts as received."""

DRAIN = 5.0
"""Seconds after which a stream without pauses is cut off."""

TOPICS = (
    (Transitions, names.TRANSITIONS, qos.EXPERIENCE_WRITER),
    (Metrics, names.METRICS, qos.LATCHED),
    (Progress, names.PROGRESS, qos.LATCHED),
)
"""What is recorded: type, topic, quality of service of its publishers."""


class Recorder(Node):
    """Writes each message as it arrives, and notes which episodes have arrived.

    Attributes:
        messages: Number of messages written so far.
    """

    def __init__(self) -> None:
        super().__init__("record", automatically_declare_parameters_from_overrides=True)
        shield(self, self.get_logger().warning)
        values = declare(self, RecorderSettings)
        self.path = Path(values["bag"] or f"recording-{datetime.now():%Y%m%d-%H%M%S}")
        self._runs: defaultdict[str, SeenEpisodes] = defaultdict(SeenEpisodes)
        self._unread = 0
        self._began = time.monotonic()
        self._bag = BagWriter(self.path)
        for kind, name, offered in TOPICS:
            self._record(kind, name, offered)

    def _record(self, kind: type, name: str, offered: QoSProfile) -> None:
        note = {Transitions: self._note_episode, Metrics: self._note_metrics}.get(kind)
        # Deep enough for a burst from all evaluators while the disk is busy.
        wanted = QoSProfile(
            depth=qos.EXPERIENCE_READER.depth,
            reliability=offered.reliability,
            durability=offered.durability,
        )
        topic = self.resolve_topic_name(name)
        self._bag.add(topic, type_name(kind), offered)
        take = partial(self._take, topic, note)
        self.create_subscription(kind, name, take, wanted, raw=True)

    @property
    def messages(self) -> int:
        """Number of messages written so far."""
        return self._bag.messages

    def _take(self, topic: str, note: Callable[[bytes], None] | None, data: bytes) -> None:
        self._bag.write(topic, data)
        if note is None:
            return
        try:
            note(data)
        except RequestError:  # recorded nevertheless; programs that read it will report it
            self._unread += 1

    def _note_episode(self, data: bytes) -> None:
        head = episode_head(data)
        self._runs[head.run_id].add(head.evaluation)

    def _note_metrics(self, data: bytes) -> None:
        run_id, evaluations = committed_evaluations(data)
        self._runs[run_id].committed = evaluations

    def close(self) -> list[str]:
        """Close the recording.

        Returns:
            Lines about its content, and about what is missing.

        Raises:
            StorageError: The recording cannot be closed.
        """
        self._bag.close()
        seconds = time.monotonic() - self._began
        size = self._bag.size / 1e6
        lines = [
            f"recorded {self._bag.messages} messages, {size:.1f} MB in {seconds:.1f} s, into {self.path}"
        ]
        for run_id, seen in self._runs.items():
            lines += _account(run_id, seen)
        if self._unread:
            lines.append(f"warning: {self._unread} messages are not what their topic carries")
        return lines


def _account(run_id: str, seen: SeenEpisodes) -> list[str]:
    """Return lines about the episodes of one run."""
    run = f"run {printable(run_id)}"
    if not seen.ids:
        return [f"{run}: no episodes"]
    repeated = f", {seen.repeated} more came twice" if seen.repeated else ""
    lines = [
        f"{run}: {len(seen.ids)} episodes, evaluations {min(seen.ids)} to {max(seen.ids)}{repeated}"
    ]
    if missing := seen.missing():
        lines.append(
            f"warning: {len(missing)} episodes between them are missing: evaluations {ranges(missing)}"
        )
    return lines


def record_until(stop: threading.Event, recorder: Recorder) -> None:
    """Record until an event is set, and then what was sent before.

    Raises:
        StorageError: The recording cannot be written.
    """
    executor = SingleThreadedExecutor()
    executor.add_node(recorder)
    while not stop.is_set():
        executor.spin_once(timeout_sec=TICK)
    latest = time.monotonic() + DRAIN
    quiet_since, before = time.monotonic(), recorder.messages
    while time.monotonic() < min(latest, quiet_since + QUIET_SECONDS):
        executor.spin_once(timeout_sec=TICK)
        if recorder.messages != before:
            quiet_since, before = time.monotonic(), recorder.messages


PROGRAM = Program(
    "record",
    "Records a run's experience, metrics and progress into a rosbag2 folder (MCAP) until Ctrl-C.",
    (RecorderSettings,),
)


def main() -> int:
    """Run the recorder.

    Returns:
        Exit code: 0, 2 for bad input or a recording that cannot be written, 1 for a fault.
    """
    stop = threading.Event()
    recorder = None
    try:
        # First of all, so that a signal never leaves an open recording.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
        if not start(PROGRAM, signal_handler_options=SignalHandlerOptions.NO):
            return 0
        recorder = Recorder()
        tell(f"recording into {recorder.path}; Ctrl-C ends it")
        record_until(stop, recorder)
        tell("\n".join(recorder.close()))
    except Exception as error:
        return report(error, starting=recorder is None)
    finally:
        if recorder is not None:
            recorder.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
