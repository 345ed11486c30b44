"""Tasks of the benches that note the core time of their episodes; no bench itself.

An episode is timed from its reset to its descriptor, policy and transitions included.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pga_me_ros.tasks.locomotion import QDHalfCheetah, QDWalker

FOLDER = "PGA_ME_EPISODE_TIMES"
"""Environment variable: where each process notes its time; without it, none does."""

if TYPE_CHECKING:
    from pga_me_ros.tasks.locomotion import LocomotionTask as _Task
else:
    _Task = object


class _Timed(_Task):
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


def environment(folder: str | Path) -> Mapping[str, str]:
    """Return the environment of processes that find these tasks and note their time in a folder."""
    here = str(Path(__file__).resolve().parent)
    path = os.pathsep.join(filter(None, [here, os.environ.get("PYTHONPATH", "")]))
    return {**os.environ, "PYTHONPATH": path, FOLDER: str(folder)}


def episode_seconds(folder: str | Path) -> float:
    """Return the core seconds that all processes noted in a folder."""
    notes = [file.read_bytes() for file in Path(folder).iterdir()]
    return sum(struct.unpack("d", note)[0] for note in notes if note)
