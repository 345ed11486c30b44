"""Tasks of the benches that note the core time of their episodes; no bench itself.

An episode is timed from its reset to its descriptor, policy and transitions included.
"""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path

import numpy as np

from pga_me_ros.tasks.locomotion import LocomotionTask, QDHalfCheetah, QDWalker

FOLDER = "PGA_ME_EPISODE_TIMES"
"""Environment variable: where each process notes its time; without it, none does."""


class _Timed(LocomotionTask):
    def __init__(self) -> None:
        super().__init__()
        self._started = self._total = 0.0
        folder = os.environ.get(FOLDER)
        self._note = (Path(folder) / str(os.getpid())).open("wb", 0) if folder else None

    def reset(self, rng: np.random.Generator) -> np.ndarray:
        self._started = time.thread_time()
        return super().reset(rng)

    def descriptor(self) -> np.ndarray:
        descriptor = super().descriptor()
        self._total += time.thread_time() - self._started
        if self._note:
            os.pwrite(self._note.fileno(), struct.pack("d", self._total), 0)
        return descriptor


class TimedWalker(_Timed, QDWalker):
    """QDWalker."""


class TimedHalfCheetah(_Timed, QDHalfCheetah):
    """QDHalfCheetah."""


def episode_seconds(folder: str | Path) -> float:
    """Return the core seconds that all processes noted in a folder."""
    notes = [file.read_bytes() for file in Path(folder).iterdir()]
    return sum(struct.unpack("d", note)[0] for note in notes if note)
