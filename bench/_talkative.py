"""A task whose episodes cost little but hold much data, so that experience is published at the highest possible rate.

With it, publishing experience is what limits an evaluator, not physics. Not a bench itself.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pga_me_ros.tasks.spec import TaskSpec

OBSERVATIONS = 100
STEPS = 200


class TalkativeTask:
    """Gives observations of a hundred numbers, 200 per episode; follows the task protocol."""

    spec: ClassVar[TaskSpec] = TaskSpec(
        name="talkative",
        observation_names=tuple(f"number {i}" for i in range(OBSERVATIONS)),
        observation_units=("1",) * OBSERVATIONS,
        action_names=("x", "y"),
        action_units=("1", "1"),
        action_low=(-1.0, -1.0),
        action_high=(1.0, 1.0),
        descriptor_names=("x", "y"),
        descriptor_low=(0.0, 0.0),
        descriptor_high=(1.0, 1.0),
        max_steps=STEPS,
        control_period=0.01,
        archive_cells=64,
        archive_bins=(8, 8),
    )

    def __init__(self) -> None:
        """Start with zeros."""
        self._numbers = np.zeros(OBSERVATIONS, np.float32)

    def reset(self, rng: np.random.Generator) -> np.ndarray:
        """Draw the numbers."""
        self._numbers = rng.uniform(-1.0, 1.0, OBSERVATIONS).astype(np.float32)
        return self._numbers.copy()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Replace the first numbers with the action."""
        self._numbers[:2] = action
        return self._numbers.copy(), 0.0, False

    def descriptor(self) -> np.ndarray:
        """Return the last action, as a point in the unit square."""
        return np.clip(0.5 + 0.5 * self._numbers[:2].astype(np.float64), 0.0, 1.0)

    def close(self) -> None:
        """Do nothing."""
