"""Gaits as they move, recorded from the simulation and packed for the page."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import RequestError
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.model import RobotState
from pga_me_ros.player.promise import is_kept
from pga_me_ros.player.recorded_gait import evaluated_again, steps_between
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.spec import TaskSpec

FRAMES_PER_SECOND = 30.0
"""About as many states of the robot per simulated second; the page draws what lies between them."""

LEVELS = 65535
"""Greatest value of a packed number: 16 bits, so an angle is told to a ten-thousandth of its range or better."""

CONTACT_LEVELS = 255
"""Greatest value of a packed entry of the strip chart."""


@dataclass(frozen=True)
class EpisodeStart:
    """Where an episode begins.

    Attributes:
        seed: Seed of an initial pose that the run has not seen; None for the one of the gait's own evaluation.
        randomization: What of robot and world is another one, see `tasks.randomization`; empty for nothing.
        damage: What is wrong with robot or world, see `tasks.damage`; empty for nothing.

    Raises:
        RequestError: The seed is below 0, or another world or robot is to begin as the evaluation.
    """

    seed: int | None = None
    randomization: str = ""
    damage: str = ""

    def __post_init__(self) -> None:
        """Check the seed."""
        if self.seed is not None and self.seed < 0:
            raise RequestError(f"seed is {self.seed}; give a whole number from 0 on.")
        if self.randomization and self.seed is None:
            raise RequestError("A randomized episode needs a seed; give one from 0 on.")
        if self.damage and self.seed is None:
            raise RequestError("An episode of a damaged robot needs a seed; give one from 0 on.")

    @property
    def key(self) -> str:
        """Name of the start in the page."""
        if self.seed is None:
            return "evaluation"
        if self.damage:
            return f"damaged:{self.seed}:{self.randomization}:{self.damage}"
        if self.randomization:
            return f"randomized:{self.seed}:{self.randomization}"
        return f"unseen:{self.seed}"

    @classmethod
    def of(cls, key: str) -> EpisodeStart:
        """Return the start of a `key`.

        Raises:
            RequestError: It is none.
        """
        kind, *words = key.split(":", 3 if key.startswith("damaged:") else 2)
        if kind == "evaluation" and not words:
            return cls()
        expected = {"unseen": 1, "randomized": 2, "damaged": 3}.get(kind)
        if expected == len(words) and words[0].isascii() and words[0].isdecimal():
            return cls(int(words[0]), *words[1:])
        raise RequestError(
            f"start is '{key}'; give evaluation, unseen:SEED, randomized:SEED:RANGES or damaged:SEED:RANGES:DAMAGE."
        )


def recorded(task: Task, settings: Settings, gait: Gait, start: EpisodeStart) -> Recording:
    """Run one episode of a gait and keep the states of its robot.

    Args:
        task: Task of the run, made with the start's randomization and damage.
        settings: Settings of the run.
        gait: The gait.
        start: Where the episode begins.

    Raises:
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    every = steps_between(FRAMES_PER_SECOND, task.spec.control_period)
    return evaluated_again(task, settings, gait, every, start.seed)


def describe_motion(
    recording: Recording, spec: TaskSpec, gait: Gait, start: EpisodeStart
) -> dict[str, Any]:
    """Return an episode fit for JSON.

    Args:
        recording: The episode.
        spec: Its task.
        gait: The gait.
        start: Where it began.

    Returns:
        ``frames`` is (F, 7 + joints): position and quaternion (x, y, z, w) of the base, positions of the movable
        joints; ``strip`` is (F, descriptor entries) where the task says which observations its descriptor is made of.
        ``seconds`` has the time of each frame.
    """
    episode, period = recording.episode, spec.control_period
    return {
        "start": start.key,
        "seed": start.seed,
        "randomization": start.randomization,
        "damage": start.damage,
        "fitness": episode.fitness,
        "descriptor": episode.descriptor.tolist(),
        "fell": episode.terminated,
        "length": episode.length * period,
        "kept": is_kept(gait, episode) if start.seed is None else None,
        "seconds": [round(step * period, 6) for step in recording.steps],
        "frames": pack(np.array(list(_rows(recording.states)), np.float64), LEVELS),
        "strip": _strip(recording, spec),
    }


def _rows(states: tuple[RobotState, ...]) -> Iterator[tuple[float, ...]]:
    """Yield base and joints of each state; quaternions are turned so that neighbors have the same sign."""
    before: tuple[float, ...] | None = None
    for state in states:
        rotation: tuple[float, ...] = state.base.rotation
        if before is not None and sum(a * b for a, b in zip(before, rotation, strict=True)) < 0.0:
            rotation = tuple(-x for x in rotation)
        before = rotation
        yield (*state.base.position, *rotation, *state.positions)


def _strip(recording: Recording, spec: TaskSpec) -> dict[str, Any] | None:
    """Return the observations that the descriptor is the mean of, such as the contact of each foot, per frame."""
    if not spec.step_descriptor_names:
        return None
    columns = [spec.observation_names.index(name) for name in spec.step_descriptor_names]
    states = recording.episode.states
    rows = [min(step + spec.step_descriptor_delay, len(states) - 1) for step in recording.steps]
    values = states[np.ix_(rows, columns)].astype(np.float64)
    return {"names": list(spec.step_descriptor_names), **pack(values, CONTACT_LEVELS)}


def pack(table: Float64Array, levels: int) -> dict[str, Any]:
    """Return a table of numbers as text, each column in steps of its range.

    Args:
        table: (rows, columns) float64.
        levels: Greatest packed value, 255 or 65,535.

    Returns:
        ``low`` and ``step`` of each column; ``data`` is base64 of (rows, columns) unsigned numbers of 8 or 16 bits,
        little endian. An entry is ``low + step * packed``.
    """
    low = table.min(axis=0)
    step = (table.max(axis=0) - low) / levels
    safe = np.where(step > 0.0, step, 1.0)
    packed = np.rint((table - low) / safe).astype("<u2" if levels > CONTACT_LEVELS else "u1")
    return {
        "columns": table.shape[1],
        "low": low.tolist(),
        "step": step.tolist(),
        "data": base64.b64encode(packed.tobytes()).decode(),
    }
