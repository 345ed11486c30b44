"""Damage: what is broken, heavier or slippery about a simulated robot and its world, the same in every episode.

A task whose class takes an argument ``damage`` gets it as text, such as ``jam foot_joint 0.3, ice``, and reads it by
`read_damage`. The robot is not told: observations keep their entries, and controllers act as if nothing had happened.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from pga_me_ros.errors import TaskError, nearest_name


class DamageError(TaskError):
    """A text that is to say what is damaged makes no sense, or a task cannot have that damage."""


@dataclass(frozen=True)
class Kind:
    """One kind of damage.

    Attributes:
        part: What it happens to: ``joint``, ``link``, or empty for the robot or world as a whole.
        low: Least value that makes sense; 0 where there is no value.
        high: Greatest.
        default: Value if none is given; None where one must be given.
        meaning: What happens, and what the value is, for people.
        valued: Whether there is a value.
    """

    part: str
    low: float
    high: float
    default: float | None
    meaning: str
    valued: bool = True


KINDS: Mapping[str, Kind] = {
    "jam": Kind("joint", -math.pi, math.pi, 0.0, "the joint is stuck at this angle, rad"),
    "weak": Kind("joint", 0.0, 1.0, 0.5, "the joint has this share of its torque"),
    "free": Kind("joint", 0.0, 0.0, 0.0, "the joint turns freely, without a motor", valued=False),
    "gone": Kind(
        "joint", 0.0, 0.0, 0.0, "the joint and everything below it is missing", valued=False
    ),
    "slippery": Kind("link", 0.0, 1.0, 0.0, "the link has this friction, where 1 is sound"),
    "load": Kind("", 0.0, 1000.0, None, "the torso carries this mass, kg"),
    "slope": Kind(
        "", -60.0, 60.0, None, "the floor rises by this angle, degrees; below 0 it falls"
    ),
    "ice": Kind("", 0.0, 1.0, 0.1, "the floor has this share of its friction"),
}
"""The kinds of damage, by the word for each."""

OF_A_MOTOR = ("jam", "weak", "free", "gone")
"""Kinds of which a joint can have one only."""


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: A key of `KINDS`.
        part: Name of the joint or link, empty where the kind has none.
        value: As the kind means it; its default if none was given.
        given: Whether the value was given.
    """

    kind: str
    part: str = ""
    value: float = 0.0
    given: bool = False


def read_damage(text: str) -> tuple[Fault, ...]:
    """Return what is wrong, in the order of the text.

    Args:
        text: ``KIND PART VALUE``, separated by commas, without PART or VALUE where the kind has none; empty for none.

    Raises:
        DamageError: A kind is unknown, a part is missing or named twice, or a value is no number or out of bounds.
    """
    faults = [_read(part) for part in text.split(",")] if text.strip() else []
    for k, fault in enumerate(faults):
        for other in faults[:k]:
            if other.part != fault.part:
                continue
            if other.kind == fault.kind:
                raise DamageError(
                    f"damage has '{' '.join(filter(None, (fault.kind, fault.part)))}' twice; give it once"
                )
            if fault.kind in OF_A_MOTOR and other.kind in OF_A_MOTOR:
                raise DamageError(
                    f"damage says '{other.kind}' and '{fault.kind}' of {fault.part}; give one of them"
                )
    return tuple(faults)


def check_parts(
    name: str, faults: Sequence[Fault], joints: Collection[str], links: Collection[str]
) -> None:
    """Check that a robot has the parts that are damaged.

    Args:
        name: Name of the task, for messages.
        faults: What is wrong.
        joints: Names of its joints with motors.
        links: Names of its links that touch the floor.

    Raises:
        DamageError: It lacks one.
    """
    for fault in faults:
        kind = KINDS[fault.kind]
        known = {"joint": joints, "link": links}.get(kind.part)
        if known is not None and fault.part not in known:
            raise DamageError(
                f"damage names the {kind.part} '{fault.part}', which {name} has not"
                f"{nearest_name(fault.part, known)}; its {kind.part}s are {', '.join(known)}"
            )


def _read(text: str) -> Fault:
    """Return the fault that a part of the text names.

    Raises:
        DamageError: As in `read_damage`.
    """
    name, *words = text.split() or [""]
    if name not in KINDS:
        raise DamageError(
            f"damage has '{text.strip()}'{nearest_name(name, KINDS)}; give KIND PART VALUE, separated by commas, where "
            f"KIND is one of {', '.join(KINDS)}"
        )
    kind = KINDS[name]
    part = ""
    if kind.part:
        if not words:
            raise DamageError(f"damage has '{name}' without a {kind.part}; say which: {name} NAME")
        part, *words = words
    if len(words) > kind.valued:
        form = " ".join([name, *[kind.part.upper()] * bool(kind.part), *["VALUE"] * kind.valued])
        raise DamageError(f"damage has '{text.strip()}'; expected '{form}': {kind.meaning}")
    if words:
        return Fault(name, part, _value(text, kind, words[0]), given=True)
    if kind.default is None:
        raise DamageError(f"damage has '{name}' without a number; {kind.meaning}")
    return Fault(name, part, kind.default)


def _value(text: str, kind: Kind, word: str) -> float:
    """Return the value of a fault.

    Raises:
        DamageError: It is no number, or out of bounds.
    """
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not kind.low <= value <= kind.high:
        raise DamageError(
            f"damage has '{text.strip()}'; expected a number from {kind.low:g} to {kind.high:g}: {kind.meaning}"
        )
    return value
