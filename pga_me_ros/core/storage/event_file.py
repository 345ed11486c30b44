"""TensorBoard events: the metrics of a run, next to metrics.csv.

TensorBoard's own package writes the records: whoever looks at them has it. This part of it takes 18 MB of memory and
imports no torch; `torch.utils.tensorboard` does, and so does `tensorboardX` where torch is installed.
"""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from pga_me_ros.core.archive.metrics import PER_OPERATOR, Metrics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import Generation
from pga_me_ros.dependencies import require_installed

WRITER = "tensorboard"
PREFIX, SUFFIX = "events.out.tfevents.", ".pga_me_ros"
"""How the names of event files begin, as TensorBoard expects, and how those of this module end."""

VERSION = "brain.Event:2"
"""First record of every event file."""

_OF_ARCHIVE = (
    "coverage",
    "coverage_share",
    "qd_score",
    "max_fitness",
    "mean_fitness",
    "min_fitness",
    "total_steps",
)


def require_event_writer() -> None:
    """Make sure that events can be written.

    Raises:
        MissingDependencyError: The package that writes them is not installed.
    """
    require_installed(WRITER)


class EventFile:
    """The events of a run, a copy of what its repertoire file holds.

    Whatever goes wrong while they are written is told once, and the run continues without them.

    Args:
        run_dir: Folder of the run.
        generations: Its generations so far. Their events are written anew and replace those of earlier starts, so that
            none is there twice or missing.
        warn: Called with one line if events cannot be written.

    Raises:
        MissingDependencyError: The package that writes them is not installed.
    """

    def __init__(
        self, run_dir: Path, generations: Sequence[Generation], warn: Callable[[str], None]
    ) -> None:
        require_event_writer()
        self._warn = warn
        self._writer: Any = None
        with self._only_warning():
            from tensorboard.summary.writer.record_writer import RecordWriter

            for earlier in run_dir.glob(f"{PREFIX}*{SUFFIX}"):
                earlier.unlink()
            name = f"{PREFIX}{time.time():.0f}.{socket.gethostname()}{SUFFIX}"
            self._writer = RecordWriter((run_dir / name).open("wb"))
            for record in [*_beginning(), *map(_record, generations)]:
                self._writer.write(record)
            self._writer.flush()

    def append(self, generation: Generation) -> None:
        """Add the events of a generation that was just committed."""
        if self._writer is not None:
            with self._only_warning():
                self._writer.write(_record(generation))
                self._writer.flush()

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        if self._writer is not None:
            with suppress(Exception):
                self._writer.close()
            self._writer = None

    @contextmanager
    def _only_warning(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # a log must never stop a run, whatever the error
            self.close()
            self._warn(
                f"TensorBoard events cannot be written and are left out until the next start: "
                f"{type(error).__name__}: {error}"
            )


def write_events(repertoire: Path, warn: Callable[[str], None]) -> None:
    """Write the events of a run that has already reached its budget.

    Args:
        repertoire: The run's file; the events go next to it.
        warn: Called with one line if events cannot be written.

    Raises:
        MissingDependencyError: The package that writes them is not installed.
        StorageError: The file is damaged.
    """
    with Repertoire.open(repertoire, read_only=True) as stored:
        generations = stored.generations()
    EventFile(repertoire.parent, generations, warn).close()


def scalars(metrics: Metrics) -> dict[str, float]:
    """Return the numbers of a generation by their tags.

    Operators that made nothing, and numbers that are unknown, are left out.
    """
    found = {f"archive/{name}": float(getattr(metrics, name)) for name in _OF_ARCHIVE}
    for operator, made in zip(Operator, metrics.offspring, strict=True):
        for name in PER_OPERATOR if made else ():
            counts = dict(zip(Operator, getattr(metrics, name), strict=True))
            found[f"{name}/{operator.label}"] = float(counts[operator])
    return {tag: value for tag, value in found.items() if not math.isnan(value)}


def _beginning() -> list[bytes]:
    """Return the first records; the second makes a TensorBoard that is watching forget what it has read before."""
    from tensorboard.compat.proto.event_pb2 import Event, SessionLog

    now = time.time()
    start = SessionLog(status=SessionLog.START)
    events = [
        Event(wall_time=now, file_version=VERSION),
        Event(wall_time=now, step=0, session_log=start),
    ]
    return [event.SerializeToString() for event in events]


def _record(generation: Generation) -> bytes:
    """Return the record of a generation: its step is the number of evaluations so far, its time that of the commit."""
    from tensorboard.compat.proto.event_pb2 import Event
    from tensorboard.compat.proto.summary_pb2 import Summary

    metrics = generation.metrics
    values = [Summary.Value(tag=t, simple_value=v) for t, v in scalars(metrics).items()]
    event = Event(
        wall_time=datetime.fromisoformat(generation.committed).timestamp(),
        step=metrics.evaluations,
        summary=Summary(value=values),
    )
    record: bytes = event.SerializeToString()
    return record
