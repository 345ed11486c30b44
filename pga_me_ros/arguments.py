"""Numbers that users give: checked, so that a mistake is named and nothing is cut off."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterable
from typing import Any

from pga_me_ros.errors import RequestError

INT64_MAX = 2**63 - 1

_NEGATIVE = re.compile(r"-((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|inf|infinity|nan)$", re.IGNORECASE)


class ArgumentParser(argparse.ArgumentParser):
    """A parser of command lines that takes -1e-3 and -inf for numbers, not for options.

    Python's own knows only negative numbers such as -1 and -0.001.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._negative_number_matcher = _NEGATIVE


def number(name: str, value: Any) -> float:
    """Return a value as a float.

    Args:
        name: What it is called, for the message.
        value: What was given.

    Raises:
        RequestError: It is not a number, or NaN.
    """
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if math.isnan(found):
        raise RequestError(f"{name} is or holds {value!r}; give a number.")
    return found


def share(name: str, value: Any) -> float:
    """Return a value as a float from 0 to 1.

    Args:
        name: What it is called, for the message.
        value: What was given.

    Raises:
        RequestError: It is not a number from 0 to 1.
    """
    found = number(name, value)
    if not 0.0 <= found <= 1.0:
        raise RequestError(f"{name} is {value}; give a share from 0 to 1.")
    return found


def whole_number(name: str, value: Any) -> int:
    """Return a value as an integer that a message can hold.

    Args:
        name: What it is called, for the message.
        value: What was given; 12.0 is 12.

    Raises:
        RequestError: It is not a whole number, or does not fit into 64 bits.
    """
    try:
        found = int(value)
        same = found == value
    except (TypeError, ValueError, OverflowError):
        found, same = 0, False
    if not same or not -INT64_MAX <= found <= INT64_MAX:
        raise RequestError(f"{name} is {value!r}; give a whole number of at most {INT64_MAX}.")
    return found


def numbers(name: str, values: Any) -> list[float]:
    """Return values as floats.

    Args:
        name: What they are called, for the message.
        values: What was given.

    Raises:
        RequestError: It is not a list of numbers, or one is NaN.
    """
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        raise RequestError(
            f"{name} is {values!r}; give a list of numbers, one per dimension, for example [0.5]."
        )
    try:
        listed = list(values)
    except TypeError:  # an array without dimensions
        raise RequestError(
            f"{name} is {values!r}; give a list of numbers, one per dimension, for example [0.5]."
        ) from None
    return [number(name, x) for x in listed]
