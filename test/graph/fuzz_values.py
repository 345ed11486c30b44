"""Values for the fields of fuzzed messages: numbers, texts and arrays, from valid to absurd."""

from __future__ import annotations

import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from hypothesis import strategies as st
from pga_me_msgs.msg import Rates

from pga_me_ros.core.settings import Settings
from pga_me_ros.ros.convert import rates_to_msg

INT64 = (-(2**63), -1, 0, 1, 7, 2**31, 2**53 + 1, 2**63 - 1)
FLOATS = (float("nan"), float("inf"), float("-inf"), -1.0, 0.0, 0.5, 1e30, -1e308, 5e-324)
STRINGS = (
    "",
    " ",
    "../../etc/passwd",
    "qd_ant",
    "no_such_task",
    "os:system",
    "ÄÖ漢字🦾",
    "\x1b[2J\x07\n\r\tline",
    "%s%n{}{0}",
    "/evaluator_0",
    "00000000-0000-0000-0000-000000000000",
    "a\x00b",
    "x" * 100_000,
)
LENGTHS = (0, 1, 2, 3, 9, 10, 11, 1000, 100_000)
HUGE = 5_000_000
"""Entries of a huge array: 20 MB of float32, 40 MB of float64."""

HUGE_ONE_IN = 150

TYPECODES = {"float": "f", "double": "d", "int64": "q", "uint8": "B", "int32": "i"}

Fault = tuple[str, Any]
"""A field and a value for which a request must be refused."""


def numbers(typecode: str, n: int, value: float = 0.1) -> array.array[Any]:
    """Return n equal numbers as the array of a field."""
    return array.array(typecode, np.full(n, value, np.dtype(typecode)).tobytes())


def lengths() -> st.SearchStrategy[int]:
    """Return lengths of arrays; sometimes tens of megabytes."""
    return st.integers(0, HUGE_ONE_IN).flatmap(
        lambda i: st.just(HUGE) if i == HUGE_ONE_IN else st.sampled_from(LENGTHS)
    )


def value_of(field_type: str) -> st.SearchStrategy[Any]:
    """Return valid and invalid values for a field of a type as named by rosidl; None if the type is a message."""
    if field_type == "boolean":
        return st.booleans()
    if field_type == "string":
        return st.one_of(
            st.sampled_from(STRINGS),
            st.text(st.characters(exclude_categories=["Cs"]), max_size=30),
        )
    if field_type in ("double", "float"):
        return st.one_of(st.sampled_from(FLOATS), st.floats(width=32))
    if field_type in ("int64", "int32"):
        bits = int(field_type[3:])
        low, high = -(2 ** (bits - 1)), 2 ** (bits - 1) - 1
        return st.one_of(
            st.sampled_from([max(low, min(high, i)) for i in INT64]), st.integers(low, high)
        )
    if field_type == "uint8":
        return st.integers(0, 255)
    if field_type == "pga_me_msgs/Rates":
        return st.sampled_from(BAD_RATES).map(bad_rates)
    if field_type.startswith("sequence<"):
        return array_of(field_type.removeprefix("sequence<").removesuffix(">"))
    return st.none()


def array_of(entry: str) -> st.SearchStrategy[Any]:
    """Return arrays of any length for a field with entries of a type."""
    if entry in ("double", "float"):
        return st.builds(numbers, st.just(TYPECODES[entry]), lengths(), st.sampled_from(FLOATS[:6]))
    if entry in TYPECODES:
        small = st.sampled_from((0, 1, 2, 200))
        return st.builds(numbers, st.just(TYPECODES[entry]), lengths(), small)
    if entry == "boolean":
        return st.builds(lambda n: [True] * min(n, 100_000), lengths())
    if entry == "string":
        return st.lists(value_of("string"), max_size=4)
    return st.none()


BAD_RATES: tuple[Fault, ...] = (
    ("n_evo", -1),
    ("n_grad", 0),
    ("n_crit", 2**63 - 1),
    ("pg_learning_rate", float("nan")),
    ("discount", 1.5),
    ("target_rate", float("inf")),
    ("iso_sigma", -1e308),
    ("target_period", -(2**63)),
)


def bad_rates(fault: Fault) -> Rates:
    """Return rates with one out of range."""
    rates = rates_to_msg(Settings(n_evo=5))
    setattr(rates, *fault)
    return rates


def of_length(name: str, typecode: str, right: int) -> list[Fault]:
    """Return faults for an array that must have a certain length."""
    wrong = (0, 1, right - 1, right + 1, 100_003)
    return [(name, numbers(typecode, n)) for n in wrong if n != right]


def not_finite(name: str, typecode: str, n: int) -> list[Fault]:
    """Return faults for an array: the right length, but numbers that are not finite."""
    return [(name, numbers(typecode, n, bad)) for bad in FLOATS[:3]]


def arrays(types: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the arrays of numbers among a message's fields, with their type codes."""
    entries = {
        name: kind.removeprefix("sequence<").removesuffix(">") for name, kind in types.items()
    }
    return [(n, TYPECODES[e]) for n, e in entries.items() if types[n] != e and e in TYPECODES]


def ints(name: str, *values: int) -> list[Fault]:
    """Return faults for a number."""
    return [(name, value) for value in values]
