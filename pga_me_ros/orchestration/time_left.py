"""Estimates how long a run still takes, from how long its generations took."""

from __future__ import annotations

import math

import numpy as np

from pga_me_ros.arrays import Float64Array

WINDOW = 20
"""Generations whose times say what a step and the rest of a generation cost now, beside other work on the machine."""

TREND = 4
"""Generations from which on episodes count as getting longer, rather than as different by chance."""


class TimeLeft:
    """Remaining time of a run.

    The initial generations are cheap: random controllers fall at once, and nothing is trained. So they say nothing
    about those to come. After them, a generation takes a fixed time, for training, and a time for each simulated step;
    both are fitted. Episodes get longer as controllers get better, and are expected to do so for as many generations as
    they have until now, but never to exceed their time limit.

    Args:
        init_generations: Number of initial generations.
        generations: Number of generations in all.
        most_steps: Maximum steps of a generation: batch size times the time limit of an episode.
    """

    def __init__(self, init_generations: int, generations: int, most_steps: int) -> None:
        self._init = min(init_generations, generations)
        self._generations = generations
        self._most_steps = most_steps
        self._early: list[tuple[float, int]] = []
        self._later: list[tuple[float, int]] = []

    def note(self, generation: int, seconds: float, steps: int) -> None:
        """Note what a generation took.

        Args:
            generation: Its number, from 0.
            seconds: Time from the end of the one before to its own end.
            steps: Steps that were simulated in it.
        """
        (self._early if generation < self._init else self._later).append((seconds, steps))

    def seconds(self, done: int, elites: float = 0.0) -> float:
        """Return the remaining seconds, NaN while they are unknown.

        Args:
            done: Number of finished generations.
            elites: Evaluations of elites at the end of the run, in batches.
        """
        total = 0.0
        step, length = math.nan, math.nan
        for noted, left in (
            (self._early, max(0, self._init - done)),
            (self._later, self._generations - max(done, self._init)),
        ):
            if left and not noted:
                return math.nan
            if noted:
                fixed, step = _costs(*_columns(noted[-WINDOW:]))
                ahead = self._steps_ahead(noted, left)
                length = float(ahead[-1])
                steps = float(ahead[:left].sum()) + length * max(0, left - len(ahead))
                total += fixed * left + step * steps
        return total + step * length * elites if elites else total

    def _steps_ahead(self, noted: list[tuple[float, int]], left: int) -> Float64Array:
        """Return the expected steps of the generations to come, up to the one from which on they stay the same.

        If there are none to come, those of the present one.
        """
        recent = max(WINDOW, len(noted) // 2)
        _, steps = _columns(noted[-recent:])
        now, slope = float(steps.mean()), 0.0
        if len(steps) >= TREND:
            slope, now = np.polyfit(np.arange(1 - len(steps), 1), steps, 1)
        ahead = np.arange(1, min(max(left, 1), len(noted)) + 1)
        return np.clip(max(now, 0.0) + max(slope, 0.0) * ahead, 0.0, self._most_steps)


def _columns(noted: list[tuple[float, int]]) -> tuple[Float64Array, Float64Array]:
    seconds, steps = np.array(noted, np.float64).T
    return seconds, steps


def _costs(seconds: Float64Array, steps: Float64Array) -> tuple[float, float]:
    """Return the seconds of a generation apart from its steps, and those of a step: least squares, neither below 0."""
    if len(seconds) >= TREND and np.ptp(steps) > 0.0:
        step, fixed = np.polyfit(steps, seconds, 1)
        if step >= 0.0 and fixed >= 0.0:
            return float(fixed), float(step)
    whole = float(seconds.sum() / max(steps.sum(), 1.0))
    if len(seconds) < TREND or np.ptp(steps) == 0.0:
        # Nothing tells the two apart yet; half of each lies between the extremes.
        return float(seconds.mean()) / 2.0, whole / 2.0
    return (float(seconds.mean()), 0.0) if step < 0.0 else (0.0, whole)
