"""The first fields of serialized messages, read without the arrays that follow.

A recorder of messages of hundreds of kilobytes has to know whose they are, without copying them once more.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from pga_me_ros.errors import RequestError

PREAMBLE = 4
"""Bytes before the first field: the encoding. The alignment of fields counts from there."""


class EpisodeHead(NamedTuple):
    """The fields of a Transitions message that identify it; `steps` is the episode's length."""

    run_id: str
    task: str
    generation: int
    evaluation: int
    fitness: float
    steps: int


def episode_head(data: bytes) -> EpisodeHead:
    """Read the head of a serialized Transitions message.

    Raises:
        RequestError: The bytes are not such a message.
    """
    fields = _HeadFields(data)
    run_id, task, _evaluator = fields.string(), fields.string(), fields.string()
    generation, evaluation = fields.number("q"), fields.number("q")
    fitness = fields.number("d")
    fields.skip_doubles()
    return EpisodeHead(run_id, task, generation, evaluation, fitness, fields.number("q"))


def committed_evaluations(data: bytes) -> tuple[str, int]:
    """Return run id and number of evaluations in the archive from a serialized Metrics message.

    Raises:
        RequestError: The bytes are not such a message.
    """
    fields = _HeadFields(data)
    fields.number("i"), fields.number("I")  # stamp
    run_id, _task = fields.string(), fields.string()
    fields.number("q")  # generation
    return run_id, fields.number("q")


class _HeadFields:
    """Reads CDR fields one after the other, as written by ROS 2 middleware."""

    def __init__(self, data: bytes) -> None:
        if len(data) < PREAMBLE or data[0] != 0 or data[1] not in (0, 1):
            raise RequestError("A message is not serialized the way ROS 2 does it (CDR).")
        self._data = data
        self._order = "<" if data[1] else ">"
        self._at = PREAMBLE

    def number(self, code: str) -> Any:
        """Return the next number; `code` as in `struct`."""
        size = struct.calcsize(f"={code}")
        self._align(size)
        try:
            (value,) = struct.unpack_from(f"{self._order}{code}", self._data, self._at)
        except struct.error:
            raise RequestError("A message is shorter than its type.") from None
        self._at += size
        return value

    def string(self) -> str:
        """Return the next string."""
        length = self.number("I")
        text = self._data[self._at : self._at + length]
        if not length or len(text) < length:
            raise RequestError("A message is shorter than its type.")
        self._at += length
        return text[:-1].decode(errors="replace")

    def skip_doubles(self) -> None:
        """Skip a sequence of float64."""
        count = self.number("I")
        if count:
            self._align(8)
            self._at += 8 * count

    def _align(self, size: int) -> None:
        self._at += -(self._at - PREAMBLE) % size
