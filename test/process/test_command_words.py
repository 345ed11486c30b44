"""Positional arguments may follow an option with several values."""

from __future__ import annotations

from pathlib import Path

import pytest

from pga_me_ros.experiment.__main__ import main as experiment
from pga_me_ros.process.command_words import is_number, positionals_first
from pga_me_ros.render.__main__ import main as render


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--descriptor 0.9 0.1 RUN --out x", "RUN --descriptor 0.9 0.1 --out x"),
        ("RUN --descriptor -0.5 1e-3", "RUN --descriptor -0.5 1e-3"),
        ("--descriptor 0.9 --seed 3 RUN", "--descriptor 0.9 --seed 3 RUN"),
        ("--descriptor inf run --size 60 40", "run --descriptor inf --size 60 40"),
        ("--descriptor", "--descriptor"),
        ("", ""),
    ],
)
def test_what_is_no_value_comes_first(words: str, expected: str) -> None:
    assert positionals_first(words.split(), "--descriptor", is_number) == expected.split()


def test_render_takes_a_run_after_a_descriptor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert render(["--descriptor", "0.9", "0.1", str(tmp_path / "no_run")]) == 2
    assert "no_run" in capsys.readouterr().err


def test_experiment_takes_a_file_after_cells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert experiment(["--list", "--cell", "a/*/*", "3", str(tmp_path / "missing.yaml")]) == 2
    assert "There is no experiment file" in capsys.readouterr().err
