"""Tasks for benches, whose runs record the core time of their work. Not a bench itself.

An episode is timed from its reset to its descriptor, including controller and transitions. For PG variation, the time
of the thread that calls it is recorded; that thread also receives messages.
"""

from __future__ import annotations

import os
import struct
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from pga_me_ros.tasks.bullet.locomotion import LocomotionTask, QDHalfCheetah, QDWalker

FOLDER = "PGA_ME_WORK_TIMES"
"""Environment variable with the folder where processes record their time; if it is not set, they do not."""

EPISODES, PG_VARIATION = "episodes", "pg"
"""Kinds of work."""


class _Note:
    """A file that always holds the seconds that this process has spent on a kind of work."""

    def __init__(self, work: str) -> None:
        folder = os.environ.get(FOLDER)
        self._file = (Path(folder) / f"{work}-{os.getpid()}").open("wb", 0) if folder else None
        self._total = 0.0

    def add(self, seconds: float) -> None:
        self._total += seconds
        if self._file:
            os.pwrite(self._file.fileno(), struct.pack("d", self._total), 0)


class _Timed(LocomotionTask):
    def __init__(self) -> None:
        super().__init__()
        self._started = 0.0
        self._note = _Note(EPISODES)

    def reset(self, rng: np.random.Generator) -> np.ndarray:
        self._started = time.thread_time()
        return super().reset(rng)

    def descriptor(self) -> np.ndarray:
        descriptor = super().descriptor()
        self._note.add(time.thread_time() - self._started)
        return descriptor


class TimedWalker(_Timed, QDWalker):
    """QDWalker."""


class TimedHalfCheetah(_Timed, QDHalfCheetah):
    """QDHalfCheetah."""


def seconds_of(work: str, folder: str | Path) -> float:
    """Return the core seconds of a kind of work that all processes recorded in a folder."""
    notes = [file.read_bytes() for file in Path(folder).glob(f"{work}-*")]
    return sum(struct.unpack("d", note)[0] for note in notes if note)


def _time_pg_variation(module: Any) -> None:
    note, vary = _Note(PG_VARIATION), module.pg_variation

    def timed(*args: Any, **options: Any) -> Any:
        start = time.thread_time()
        try:
            return vary(*args, **options)
        finally:
            note.add(time.thread_time() - start)

    module.pg_variation = timed


# A run's nodes import its task; the variation node has imported that module by then, and the others import no torch.
if FOLDER in os.environ and (_maker := sys.modules.get("pga_me_ros.core.variation.make_offspring")):
    _time_pg_variation(_maker)
