"""What controllers are meant to achieve travels with requests for evaluations, and only where there is something."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pga_me_ros.errors import RequestError
from pga_me_ros.ros.evaluations import aims_from_msg, aims_to_msg

NONE = [math.nan, math.nan]


def test_aims_come_back_bit_for_bit() -> None:
    rows = np.array([[0.1 + 0.2, -1.0], NONE, [0.0, 1.0 / 3.0]])
    first, none, last = aims_from_msg(aims_to_msg(rows), 3, 2)
    assert none is None
    assert np.array([first, last]).tobytes() == rows[[0, 2]].tobytes()


def test_where_nobody_has_an_aim_nothing_travels() -> None:
    field = aims_to_msg(np.array([NONE, NONE]))
    assert len(field) == 0
    assert aims_from_msg(field, 2, 2) == [None, None]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ([0.5], "'intended_descriptors' has 1 entries"),
        ([0.5] * 6, "'intended_descriptors' has 6 entries"),
        ([0.5, 0.5, 0.5, math.inf], "'intended_descriptors' holds NaN or infinity"),
        ([0.5, 0.5, math.nan, 0.5], "'intended_descriptors' holds NaN or infinity"),
    ],
)
def test_what_is_no_aim_is_refused(data: list[float], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        aims_from_msg(data, 2, 2)
