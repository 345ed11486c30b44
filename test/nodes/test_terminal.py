"""The line of progress in terminals of any width."""

from __future__ import annotations

import pytest

from pga_me_ros.nodes.terminal import Terminal, fitted

PARTS = ["qd_ant", "evaluations 5/9", "best 3"]


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        (200, "qd_ant  evaluations 5/9  best 3"),
        (32, "qd_ant  evaluations 5/9  best 3"),
        (31, "qd_ant  evaluations 5/9"),
        (24, "qd_ant  evaluations 5/9"),
        (23, "qd_ant"),
        (4, "qd_"),
        (1, "q"),
        (0, "q"),
    ],
)
def test_parts_that_do_not_fit_are_left_out(columns: int, line: str) -> None:
    assert fitted(PARTS, columns) == line


def test_without_a_terminal_every_line_stays(capsys: pytest.CaptureFixture[str]) -> None:
    terminal = Terminal()
    terminal.show(PARTS)
    terminal.say("a word")
    terminal.show(PARTS)
    terminal.close()
    line = "qd_ant  evaluations 5/9  best 3\n"
    assert capsys.readouterr().out == f"{line}a word\n{line}"
