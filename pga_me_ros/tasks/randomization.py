"""Domain randomization: what of a robot and its world is another in each episode, and within which limits.

A task whose class takes an argument ``randomization`` gets it as text, such as ``mass 0.8 1.2, friction 0.5 1.0``, and
reads it by `read_ranges`. Everything is drawn from the episode's own generator, so an episode stays a function of its
generator and its actions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pga_me_ros.errors import TaskError, nearest_name


class RandomizationError(TaskError):
    """A text that is to say what is randomized makes no sense, or a task cannot have it."""


@dataclass(frozen=True)
class Kind:
    """One thing that can be randomized.

    Attributes:
        low: Least value that makes sense.
        high: Greatest.
        whole: Whether values are whole numbers.
        meaning: What a value is, for people.
    """

    low: float
    high: float
    meaning: str
    whole: bool = False


KINDS: Mapping[str, Kind] = {
    "mass": Kind(0.05, 20.0, "factor of each link's mass and inertia, one of its own per link"),
    "friction": Kind(0.0, 20.0, "factor of the floor's friction"),
    "torque": Kind(0.0, 20.0, "factor of each motor's torque, one of its own per motor"),
    "delay": Kind(0, 50, "control steps that pass before an action takes effect", whole=True),
    "noise": Kind(
        0.0, 5.0, "standard deviation of the noise on each entry of the observation but contacts"
    ),
    "push": Kind(0.0, 10_000.0, "N, force on the torso for a tenth of a second, once a second"),
}
"""What can be randomized, by the word for it."""

Ranges = Mapping[str, tuple[float, float]]


def read_ranges(text: str) -> Ranges:
    """Return the limits of what is randomized, by kind, in the order of `KINDS`.

    Args:
        text: Kinds with their limits, ``KIND LOW HIGH``, or ``KIND VALUE`` for one that is always the same, separated
            by commas; empty for none.

    Raises:
        RandomizationError: A kind is unknown or named twice, or its limits are no numbers, out of bounds, or the
            greater one comes first.
    """
    found: dict[str, tuple[float, float]] = {}
    for part in text.split(",") if text.strip() else ():
        name, *words = part.split() or [""]
        if name not in KINDS:
            raise RandomizationError(
                f"randomization has '{part.strip()}'{nearest_name(name, KINDS)}; give KIND LOW HIGH, separated by "
                f"commas, where KIND is one of {', '.join(KINDS)}"
            )
        if name in found:
            raise RandomizationError(f"randomization has {name} twice; give it once")
        found[name] = _limits(name, words)
    return {name: found[name] for name in KINDS if name in found}


def canonical(text: str) -> str:
    """Return the text that stands for all texts that `read_ranges` reads as the same: ``friction 0.30 0.60`` or others.

    Raises:
        RandomizationError: As in `read_ranges`.
    """
    return ", ".join(
        " ".join([name, *(repr(x + 0.0).removesuffix(".0") for x in dict.fromkeys(limits))])
        for name, limits in read_ranges(text).items()
    )


def _limits(name: str, words: list[str]) -> tuple[float, float]:
    """Return the limits of a kind.

    Raises:
        RandomizationError: They are not what `read_ranges` wants.
    """
    kind = KINDS[name]
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(math.isfinite(x) for x in numbers):
        raise RandomizationError(
            f"randomization gives {name} '{' '.join(words)}'; give two numbers, the least and the greatest: "
            f"{kind.meaning}"
        )
    low, high = numbers[0], numbers[-1]
    if low > high:
        raise RandomizationError(
            f"randomization gives {name} {low:g} to {high:g}; give the smaller number first"
        )
    if low < kind.low or high > kind.high:
        raise RandomizationError(
            f"randomization gives {name} {low:g} to {high:g}; expected numbers from {kind.low:g} to {kind.high:g}: "
            f"{kind.meaning}"
        )
    if kind.whole and not (low.is_integer() and high.is_integer()):
        raise RandomizationError(
            f"randomization gives {name} {low:g} to {high:g}; give whole numbers: {kind.meaning}"
        )
    return low, high
