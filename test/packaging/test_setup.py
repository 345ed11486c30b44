"""The setup script: its messages on an unsuitable machine, and how it recovers. Installs nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ["sh", "dirname", "gcc", "g++", "make"]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a checkout with the files that the setup itself needs."""
    for folder in ("scripts", "requirements", "msg_defs"):
        shutil.copytree(
            ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__")
        )
    return tmp_path


@pytest.fixture
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder that serves as the whole PATH: Python 3.11, gcc, g++, make."""
    folder = tmp_path_factory.mktemp("bin")
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found, f"this test needs {tool}"
        (folder / tool).symlink_to(found)
    (folder / "python3.11").symlink_to(Path(sys.executable).resolve())
    return folder


def set_up(checkout: Path, path: Path, *steps: str, python: str = "") -> tuple[int, list[str]]:
    """Run the script with the given PATH; return its exit status and output lines."""
    result = subprocess.run(
        [str(checkout / "scripts" / "setup.sh"), *steps],
        env={"PATH": str(path), "HOME": os.environ.get("HOME", "/"), "PYTHON": python},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return result.returncode, result.stdout.splitlines()


@pytest.mark.parametrize(
    ("missing", "named"), [("g++", "C++ compiler"), ("gcc", "C compiler"), ("make", "make")]
)
def test_missing_tool_is_named_in_one_line(
    checkout: Path, machine: Path, missing: str, named: str
) -> None:
    (machine / missing).unlink()
    status, lines = set_up(checkout, machine)
    assert (status, len(lines)) == (1, 1)
    assert named in lines[0]


def test_missing_tool_is_noticed_before_anything_is_created(checkout: Path, machine: Path) -> None:
    (machine / "g++").unlink()
    set_up(checkout, machine)
    assert not (checkout / ".venv").exists()


def test_missing_python_is_named_in_one_line(checkout: Path, machine: Path) -> None:
    (machine / "python3.11").unlink()
    status, lines = set_up(checkout, machine)
    assert (status, len(lines)) == (1, 1)
    assert "no Python 3.11" in lines[0]


@pytest.mark.parametrize("answer", ["exit 1", "exit 0", "echo 3.12"])
def test_wrong_python_is_named_in_one_line(checkout: Path, machine: Path, answer: str) -> None:
    other = checkout / "other-python"
    other.write_text(f"#!/bin/sh\n{answer}\n")
    other.chmod(0o755)
    status, lines = set_up(checkout, machine, python=str(other))
    assert (status, len(lines)) == (1, 1)
    assert f"PYTHON={other}" in lines[0]


def test_failing_step_shows_the_error_and_the_log(checkout: Path, machine: Path) -> None:
    (checkout / "requirements" / "run.txt").write_text("./no-such-package\n")
    status, lines = set_up(checkout, machine)
    assert status == 1
    assert "no-such-package" in "".join(lines[:-1])
    assert str(checkout / ".venv" / "setup.log") in lines[-1]


def test_finished_step_is_not_run_again(checkout: Path, machine: Path) -> None:
    set_up(checkout, machine, "venv")
    assert set_up(checkout, machine, "venv") == (0, [])


def test_environment_whose_installation_was_interrupted_is_recreated(
    checkout: Path, machine: Path
) -> None:
    set_up(checkout, machine, "venv")
    leftover = checkout / ".venv" / "leftover"
    leftover.touch()
    (checkout / ".venv" / ".stamps" / "requirements").write_text("running")
    status, _ = set_up(checkout, machine, "venv")
    assert (status, leftover.exists()) == (0, False)


def test_moved_environment_is_recreated(checkout: Path, machine: Path) -> None:
    set_up(checkout, machine, "venv")
    moved = checkout.rename(checkout.with_name(f"{checkout.name}-moved"))
    set_up(moved, machine, "venv")
    assert str(moved) in (moved / ".venv" / "bin" / "activate").read_text()
