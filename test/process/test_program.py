"""How a program ends."""

from __future__ import annotations

from pathlib import Path

import pytest

from pga_me_ros.process.program import run_program


def test_an_error_of_the_system_is_told_with_its_file_and_what_to_do(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run_program(lambda: Path("/nowhere/file").touch()) == 2
    expected = "error: '/nowhere/file': No such file or directory; check the path, its permissions"
    error = capsys.readouterr().err
    assert error.startswith(expected)
    assert error.count("\n") == 1
