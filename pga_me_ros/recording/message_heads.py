"""The first fields of serialised messages, read without the arrays that follow.

Who records hundreds of kilobytes per message wants to know whose they are, but not to copy them once more.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from pga_me_ros.errors import RequestError

PREAMBLE = 4
"""Bytes before the first field: the encoding. Fields are aligned to what follows it."""


class EpisodeHead(NamedTuple):
    """What a Transitions message is about: its fields of these names; `steps` is the episode's length."""

    run_id: str
    task: str
    generation: int
    evaluation: int
    fitness: float
    steps: int


def episode_head(data: bytes) -> EpisodeHead:
    """Read the head of a serialised Transitions message.

    Raises:
        RequestError: The bytes are no such message.
    """
    fields = _HeadFields(data)
    run_id, task, _evaluator = fields.string(), fields.string(), fields.string()
    generation, evaluation = fields.number("q"), fields.number("q")
    fitness = fields.number("d")
    fields.skip_doubles()
    return EpisodeHead(run_id, task, generation, evaluation, fitness, fields.number("q"))


def committed_evaluations(data: bytes) -> tuple[str, int]:
    """Read from a serialised Metrics message whose run it is of, and how many evaluations are in its archive.

    Raises:
        RequestError: The bytes are no such message.
    """
    fields = _HeadFields(data)
    fields.number("i"), fields.number("I")  # stamp
    run_id, _task = fields.string(), fields.string()
    fields.number("q")  # generation
    return run_id, fields.number("q")


class _HeadFields:
    """Reads CDR fields one after the other, as ROS 2 middleware writes them."""

    def __init__(self, data: bytes) -> None:
        if len(data) < PREAMBLE or data[0] != 0 or data[1] not in (0, 1):
            raise RequestError("A message is not serialised as ROS 2 does (CDR).")
        self._data = data
        self._order = "<" if data[1] else ">"
        self._at = PREAMBLE

    def number(self, code: str) -> Any:
        """Return the next number, `code` as in `struct`."""
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
        """Pass over a sequence of float64."""
        count = self.number("I")
        if count:
            self._align(8)
            self._at += 8 * count

    def _align(self, size: int) -> None:
        self._at += -(self._at - PREAMBLE) % size
