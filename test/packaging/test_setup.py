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


def copy_of_checkout(folder: Path) -> Path:
    """Copy the files that the setup itself needs into a folder."""
    skipped = shutil.ignore_patterns("__pycache__")
    for name in ("scripts", "requirements", "msg_defs"):
        shutil.copytree(ROOT / name, folder / name, ignore=skipped)
    return folder


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a checkout without an environment."""
    return copy_of_checkout(tmp_path)


def machine_in(folder: Path) -> Path:
    """Make a folder that serves as the whole PATH: Python, gcc, g++, make."""
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found, f"this test needs {tool}"
        (folder / tool).symlink_to(found)
    (folder / "python3").symlink_to(Path(sys.executable).resolve())
    return folder


@pytest.fixture
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the PATH of a machine with all tools; a test may remove some."""
    return machine_in(tmp_path_factory.mktemp("bin"))


@pytest.fixture(scope="module")
def with_venv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a checkout whose environment was created; a test leaves it with one."""
    checkout = copy_of_checkout(tmp_path_factory.mktemp("checkout"))
    set_up(checkout, machine_in(tmp_path_factory.mktemp("bin")), "venv")
    return checkout


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
    (machine / "python3").unlink()
    status, lines = set_up(checkout, machine)
    assert (status, len(lines)) == (1, 1)
    assert "no Python 3.11, 3.12 or 3.13 on PATH" in lines[0]


@pytest.mark.parametrize("answer", ["exit 1", "exit 0", "echo 3.10", "echo 3.14"])
def test_wrong_python_is_named_in_one_line(checkout: Path, machine: Path, answer: str) -> None:
    other = checkout / "other-python"
    other.write_text(f"#!/bin/sh\n{answer}\n")
    other.chmod(0o755)
    status, lines = set_up(checkout, machine, python=str(other))
    assert (status, len(lines)) == (1, 1)
    assert f"PYTHON={other}" in lines[0]
    assert "give the path of a Python 3.11, 3.12 or 3.13" in lines[0]


@pytest.mark.parametrize(
    ("versions", "taken"),
    [(("3.12", "3.13", "3.14"), "3.13"), (("3.11", "3.12", "3.13"), "3.11")],
)
def test_a_python_with_wheels_for_all_is_taken_or_the_newest_supported_one(
    checkout: Path, machine: Path, versions: tuple[str, ...], taken: str
) -> None:
    for version in versions:
        other = machine / f"python{version}"
        other.write_text(
            f'#!/bin/sh\ncase "$*" in *setup_venv*) echo started {version} ;; *) echo {version} ;; esac\n'
        )
        other.chmod(0o755)
    assert set_up(checkout, machine) == (0, [f"started {taken}"])


def test_an_environment_keeps_its_python_until_another_is_named(
    with_venv: Path, machine: Path
) -> None:
    other = machine / "python3.13"
    other.write_text('#!/bin/sh\ncase "$*" in *setup_venv*) echo started ;; *) echo 3.13 ;; esac\n')
    other.chmod(0o755)
    assert set_up(with_venv, machine, "venv") == (0, [])
    assert set_up(with_venv, machine, "venv", python=str(other)) == (0, ["started"])


def test_an_environment_of_another_python_is_made_anew(
    with_venv: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import setup_steps

    monkeypatch.setattr(setup_steps, "VENV", with_venv / ".venv")
    assert not setup_steps.is_of_another_python()
    settings = with_venv / ".venv" / "pyvenv.cfg"
    before = settings.read_text()
    settings.write_text(before.replace("version = 3.", "version = 3.9"))
    assert setup_steps.is_of_another_python()
    settings.write_text(before)


def test_a_kept_wheel_of_pybullet_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import setup_steps

    monkeypatch.setattr(setup_steps, "WHEELS", tmp_path)
    monkeypatch.setattr(setup_steps, "VENV", tmp_path / "no-environment")
    version = setup_steps.pin("pybullet").partition("==")[2]
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    with pytest.raises(FileNotFoundError):  # builds it, and finds no pip to do so
        setup_steps.keep_pybullet_wheel()
    (tmp_path / f"pybullet-{version}-{tag}-{tag}-linux_x86_64.whl").touch()
    setup_steps.keep_pybullet_wheel()


def test_failing_step_shows_the_error_and_the_log(with_venv: Path, machine: Path) -> None:
    requirements = with_venv / "requirements" / "run.txt"
    before = requirements.read_text()
    requirements.write_text(f"./no-such-package\n{before}")
    status, lines = set_up(with_venv, machine)
    requirements.write_text(before)
    assert status == 1
    assert "no-such-package" in "".join(lines[:-1])
    assert str(with_venv / ".venv" / "setup.log") in lines[-1]


def test_finished_step_is_not_run_again(with_venv: Path, machine: Path) -> None:
    assert set_up(with_venv, machine, "venv") == (0, [])


def test_environment_whose_installation_was_interrupted_is_recreated(
    with_venv: Path, machine: Path
) -> None:
    leftover = with_venv / ".venv" / "leftover"
    leftover.touch()
    (with_venv / ".venv" / ".stamps" / "requirements").write_text("running")
    status, _ = set_up(with_venv, machine, "venv")
    assert (status, leftover.exists()) == (0, False)


def test_moved_environment_is_recreated(with_venv: Path, tmp_path: Path, machine: Path) -> None:
    moved = shutil.copytree(with_venv, tmp_path / "moved", symlinks=True)
    set_up(moved, machine, "venv")
    assert str(moved) in (moved / ".venv" / "bin" / "activate").read_text()
