"""Counts per operator, named, so that an operator more changes no expectation."""

from __future__ import annotations

from pga_me_ros.core.operators import Operator


def per_operator(**counts: int) -> tuple[int, ...]:
    """Return counts in the order of `Operator`, zeros for those that are not named, as in ``per_operator(ga=3)``."""
    names = [operator.name.lower() for operator in Operator]
    assert counts.keys() <= set(names)
    return tuple(counts.get(name, 0) for name in names)
