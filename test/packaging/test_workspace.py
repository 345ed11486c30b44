"""Installation with colcon and pip, each from a copy of the checkout."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOT_COPIED = (".git", ".venv", "build", "install", "log", "runs", "__pycache__", "*.egg-info")
NODES = [
    "adapter",
    "archive_manager",
    "behavior_player",
    "controller",
    "critic_trainer",
    "evaluator",
    "orchestrator",
    "record",
    "variation",
]
PROGRAMS = [
    "adapt_demo",
    "experiment",
    "explorer",
    "export",
    "query",
    "reevaluate",
    "render",
    "replay",
    "report",
    "thin",
]

TINY_RUN = {
    "evaluations": "24",
    "random_init": "8",
    "batch_size": "8",
    "n_evo": "4",
    "n_crit": "2",
    "cells": "16",
    "cvt_samples": "1000",
    "evaluators": "1",
    "serve": "false",
    "discovery_wait": "0.0",
}
TINY_RUN_SECONDS = 240

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@dataclass(frozen=True)
class Installation:
    """Where the package was installed, and what to source or set before use."""

    prefix: Path
    before: str

    def bash(self, script: str, timeout: float = 60) -> subprocess.CompletedProcess[str]:
        """Run a script in a shell in which the installation is found.

        The shell leads a process group, which is killed as a whole at the timeout.
        """
        process = subprocess.Popen(
            ["bash", "-c", f"{self.before}\n{script}"],
            cwd="/",
            env=plain_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
            output += f"\n(ended after {timeout} s)"
        return subprocess.CompletedProcess(script, process.returncode, output)


def plain_environment() -> dict[str, str]:
    """Return the environment of a shell in which only the virtual environment was sourced."""
    # Set by the interpreter that runs the tests, not by the user's shell.
    hidden = ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH", "PYTHONPATH")
    return {name: value for name, value in os.environ.items() if name not in hidden} | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    }


def copy_of_checkout(folder: Path) -> Path:
    def ignore(where: str, names: list[str]) -> list[str]:
        """Skip what git ignores, but only at the top level: the package has its own folder `core/runs`."""
        left_out = {*NOT_COPIED} if Path(where) == ROOT else {"__pycache__"}
        return [name for name in names if name in left_out]

    return Path(shutil.copytree(ROOT, folder / "checkout", symlinks=True, ignore=ignore))


def run(command: str, cwd: Path) -> None:
    script = f". {shlex.quote(sys.prefix)}/setup.bash && {command}"
    result = subprocess.run(
        ["bash", "-c", script],
        cwd=cwd,
        env=plain_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout[-4000:]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """Return the workspace that colcon built from both packages."""
    checkout = copy_of_checkout(tmp_path_factory.mktemp("workspace"))
    run("colcon build --base-paths . msg_defs", checkout)
    sourced = f". {sys.prefix}/setup.bash; . {checkout}/install/setup.bash"
    return Installation(checkout / "install" / "pga_me_ros", sourced)


@pytest.fixture(scope="module")
def symlinked(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """Return a workspace with only pga_me_ros, linked to its sources."""
    checkout = copy_of_checkout(tmp_path_factory.mktemp("symlinked"))
    run("colcon build --symlink-install --packages-select pga_me_ros", checkout)
    sourced = f". {sys.prefix}/setup.bash; . {checkout}/install/setup.bash"
    return Installation(checkout / "install" / "pga_me_ros", sourced)


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """Return a prefix into which pip installed pga_me_ros."""
    folder = tmp_path_factory.mktemp("pip")
    checkout, prefix = copy_of_checkout(folder), folder / "prefix"
    run(
        f"python -m pip install -q --ignore-installed --no-deps --no-build-isolation --prefix {prefix} .",
        checkout,
    )
    site = prefix / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}"
    before = (
        f". {sys.prefix}/setup.bash; export PYTHONPATH={site}/site-packages "
        f"AMENT_PREFIX_PATH={prefix}:$AMENT_PREFIX_PATH"
    )
    return Installation(prefix, before)


@pytest.fixture(params=["workspace", "symlinked", "prefix"])
def installation(request: pytest.FixtureRequest) -> Installation:
    return request.getfixturevalue(request.param)


def test_ament_index_finds_the_package(installation: Installation) -> None:
    ask = "from ament_index_python import get_package_prefix as p; print(p('pga_me_ros'))"
    result = installation.bash(f'python3 -c "{ask}"')
    assert result.stdout.strip() == str(installation.prefix)


def test_every_node_and_program_is_an_executable(installation: Installation) -> None:
    folder = installation.prefix / "lib" / "pga_me_ros"
    assert [path.name for path in sorted(folder.iterdir()) if os.access(path, os.X_OK)] == sorted(
        NODES + PROGRAMS
    )


def test_executables_run_in_the_python_on_path(installation: Installation, tmp_path: Path) -> None:
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\necho that of PATH\n")
    python.chmod(0o755)
    for name in ("orchestrator", "query"):
        executable = installation.prefix / "lib" / "pga_me_ros" / name
        result = installation.bash(f"export PATH={tmp_path}:$PATH; exec {executable}")
        assert result.stdout == "that of PATH\n"


def test_every_config_is_installed(installation: Installation) -> None:
    installed = installation.prefix / "share" / "pga_me_ros" / "config"
    names = sorted(path.name for path in (ROOT / "config").iterdir())
    assert names
    assert sorted(path.name for path in installed.iterdir()) == names


def test_installed_code_is_imported(installation: Installation) -> None:
    result = installation.bash('python3 -c "import pga_me_ros; print(pga_me_ros.__file__)"')
    assert str(installation.prefix.parents[1]) in result.stdout


def test_colcon_runs_the_tests_that_colcon_pkg_names_and_reports_failures(
    symlinked: Installation,
) -> None:
    checkout = symlinked.prefix.parents[1]
    arguments = json.loads((checkout / "colcon.pkg").read_text())["pytest-args"]
    folders = [checkout / word for word in arguments if word.startswith("test/")]
    for folder in folders:  # a small test instead of each folder's own, which take minutes
        shutil.rmtree(folder)
        folder.mkdir()
        (folder / f"test_of_{folder.name}.py").write_text("def test_passes(): pass\n")
    (folders[0] / "test_failing.py").write_text("def test_fails(): assert False\n")
    colcon = f"cd {checkout} && colcon"
    tested = symlinked.bash(f"{colcon} test --packages-select pga_me_ros")
    assert "1 package had test failures: pga_me_ros" in tested.stdout
    reported = symlinked.bash(f"{colcon} test-result --verbose")
    assert reported.returncode == 1
    assert f"{len(folders) + 1} tests, 0 errors, 1 failure, 0 skipped" in reported.stdout
    assert "test_fails" in reported.stdout


def test_workspace_has_its_own_messages(workspace: Installation) -> None:
    result = workspace.bash('python3 -c "import pga_me_msgs.msg as m; print(m.__file__)"')
    assert result.stdout.startswith(str(workspace.prefix.parent / "pga_me_msgs"))


def test_installed_orchestrator_makes_a_repertoire(workspace: Installation, tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    parameters = {**TINY_RUN, "run_dir": str(run_dir)}
    arguments = " ".join(f"-p {name}:={value}" for name, value in parameters.items())
    config = workspace.prefix / "share" / "pga_me_ros" / "config" / "qd_walker.yaml"
    executable = workspace.prefix / "lib" / "pga_me_ros" / "orchestrator"
    result = workspace.bash(
        f"exec {executable} --ros-args --params-file {config} {arguments}", TINY_RUN_SECONDS
    )
    assert result.returncode == 0, result.stdout[-4000:]
    with sqlite3.connect(run_dir / "repertoire.db") as connection:
        (elites,) = connection.execute("SELECT count(*) FROM elites").fetchone()
    assert elites > 0
