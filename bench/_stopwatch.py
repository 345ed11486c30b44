"""Divides the time of one process between named parts. Not a bench itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class Stopwatch:
    """Times function calls; the time of nested timed calls counts only for the inner one.

    Attributes:
        seconds: Time per part since the last `clear`.
    """

    def __init__(self) -> None:
        """Start without measurements."""
        self.seconds: dict[str, float] = {}
        self._within: list[float] = []  # seconds of inner parts, per active call

    def clear(self) -> None:
        """Forget all measurements."""
        self.seconds = {}

    @contextmanager
    def timing(self, *calls: tuple[Any, str, str]) -> Iterator[None]:
        """Time functions within the block; each is given as (owner, attribute, part)."""
        before = [(owner, name, getattr(owner, name)) for owner, name, _ in calls]
        for owner, name, part in calls:
            setattr(owner, name, self._timed(getattr(owner, name), part))
        try:
            yield
        finally:
            for owner, name, function in before:
                setattr(owner, name, function)

    def _timed(self, function: Any, part: str) -> Any:
        def timed(*args: Any, **options: Any) -> Any:
            self._within.append(0.0)
            start = time.perf_counter()
            try:
                return function(*args, **options)
            finally:
                took = time.perf_counter() - start
                inner = self._within.pop()
                self.seconds[part] = self.seconds.get(part, 0.0) + took - inner
                if self._within:
                    self._within[-1] += took

        return timed
