"""Counts per operator by name, so that a new operator changes no expectation."""

from __future__ import annotations

from pga_me_ros.core.operators import Operator


def per_operator(**counts: int) -> tuple[int, ...]:
    """Return counts in the order of `Operator`, 0 for those not given, as in ``per_operator(ga=3)``."""
    names = [operator.name.lower() for operator in Operator]
    assert counts.keys() <= set(names)
    return tuple(counts.get(name, 0) for name in names)
