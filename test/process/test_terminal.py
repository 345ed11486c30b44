"""The progress line in terminals of any width."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest
from rclpy.logging import get_logger

from pga_me_ros.orchestration.control import CalmLogger
from pga_me_ros.process.terminal import Terminal, fitted

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


def test_output_is_logged_with_its_time(tmp_path: Path) -> None:
    for _ in range(2):  # a resumed run appends to the same file
        terminal = Terminal()
        terminal.say("before the file")
        terminal.record(tmp_path / "orchestrator.log")
        terminal.show(PARTS)
        logger = CalmLogger(get_logger("terminal"), terminal)
        logger.warning("a leg is missing")
        logger.warn("another one")  # as rclpy does for exceptions in callbacks
        logger.fatal("fell over")
    lines = (tmp_path / "orchestrator.log").read_text().splitlines()
    assert [line.partition(" ")[2] for line in lines] == [
        "qd_ant  evaluations 5/9  best 3",
        "warning: a leg is missing",
        "warning: another one",
        "fatal: fell over",
    ] * 2
    assert all(datetime.fromisoformat(line.split()[0]).tzinfo for line in lines)
