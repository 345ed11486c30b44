"""A task that sleeps for as long as physics would take and costs the machine next to nothing.

With it, many evaluators fit on few cores, and only the graph limits their throughput. Not a bench itself.
"""

from __future__ import annotations

import time
from typing import ClassVar

import numpy as np

from pga_me_ros.tasks.spec import TaskSpec

EPISODE = 0.33
"""Seconds per episode, about as long as 1000 steps of QDHalfCheetah take."""

STEPS = 50
"""Steps per episode; few, so that controllers cost little."""


class SleepingTask:
    """Moves a point by its actions, and sleeps once per episode; follows the task protocol."""

    spec: ClassVar[TaskSpec] = TaskSpec(
        name="sleeping",
        observation_names=("x", "y"),
        observation_units=("m", "m"),
        action_names=("x velocity", "y velocity"),
        action_units=("m/s", "m/s"),
        action_low=(-1.0, -1.0),
        action_high=(1.0, 1.0),
        descriptor_names=("x", "y"),
        descriptor_low=(0.0, 0.0),
        descriptor_high=(1.0, 1.0),
        max_steps=STEPS,
        control_period=EPISODE / STEPS,
        archive_cells=256,
        archive_bins=(16, 16),
    )

    def __init__(self) -> None:
        """Start at the origin."""
        self._place = np.zeros(2, np.float32)

    def reset(self, rng: np.random.Generator) -> np.ndarray:
        """Sleep, then begin near the origin."""
        time.sleep(EPISODE)
        self._place = rng.uniform(-0.1, 0.1, 2).astype(np.float32)
        return self._place.copy()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Move by the action; smaller actions earn more."""
        self._place = self._place + action / np.float32(STEPS)
        return self._place, -float(np.square(action).mean()), False

    def descriptor(self) -> np.ndarray:
        """Return the position, as shares of the square from -1 to 1."""
        return np.clip(0.5 + 0.5 * self._place.astype(np.float64), 0.0, 1.0)

    def close(self) -> None:
        """Do nothing."""
