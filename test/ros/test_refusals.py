"""Logged refusals: in one line, without a stranger's control characters, and limited in number."""

from __future__ import annotations

import pytest

from pga_me_ros.errors import RequestError
from pga_me_ros.ros.convert import MOST_LAYERS, layers_from_msg
from pga_me_ros.ros.refusals import BURST, LONGEST, CalmRefusals, printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("no such cell: 'Ähre 漢字'", "no such cell: 'Ähre 漢字'"),
        ("two\nlines\r\tand a bell\x07", r"two\nlines\r\tand a bell\x07"),
        ("\x1b[2Jscreen cleared", r"\x1b[2Jscreen cleared"),
    ],
)
def test_a_strangers_text_stays_in_one_line(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_a_strangers_text_is_shortened() -> None:
    shown = printable("x" * 10**6)
    assert shown == "x" * LONGEST + "... (1000000 characters)"


def test_many_refusals_are_logged_in_part_and_the_rest_counted() -> None:
    refusals = CalmRefusals()
    lines = [refusals.line("no") for _ in range(1000)]
    assert lines[:BURST] == ["no"] * BURST
    assert sum(line is not None for line in lines) < 2 * BURST
    refusals._looked -= 1.0  # as if a second had passed
    left = refusals.line("no")
    assert left is not None
    assert left.startswith("no (9")
    assert left.endswith(" more refusals before this one)")


def test_a_network_of_a_million_layers_is_refused_by_its_length() -> None:
    assert layers_from_msg([3, 2, 1], "sizes").sizes == (3, 2, 1)
    with pytest.raises(RequestError, match="'sizes' has 101 entries"):
        layers_from_msg([1] * (MOST_LAYERS + 1), "sizes")
