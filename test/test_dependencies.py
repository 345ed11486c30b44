"""A package that is not installed: one line with the command that installs it, from every program and node."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pga_me_msgs
import pytest

from pga_me_ros import nodes
from pga_me_ros.dependencies import (
    EXIT_BAD_INPUT,
    MissingDependencyError,
    missing,
    missing_dependency,
)
from pga_me_ros.ros import own_messages
from pga_me_ros.ros.own_messages import DEFINITIONS

HIDE = """
import os
from importlib.machinery import PathFinder

find = PathFinder.find_spec


def find_all_but_hidden(name, path=None, target=None):
    hidden = os.environ["HIDDEN"]
    return None if name.partition(".")[0] == hidden else find(name, path, target)


PathFinder.find_spec = find_all_but_hidden
"""
"""Run at the start of each Python: one package is then not found, as if it were not installed."""


def run_finding(first: Path, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a command whose Python looks for modules in a folder first; it starts in the folder above."""
    pythonpath = os.pathsep.join(filter(None, [str(first), os.environ.get("PYTHONPATH", "")]))
    return subprocess.run(
        command,
        cwd=first.parent,
        env={**os.environ, **variables, "PYTHONPATH": pythonpath},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.fixture
def hiding(tmp_path: Path):
    """Return a function that runs a command in whose processes a package is not installed."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(HIDE)
    return lambda hidden, *command: run_finding(site, *command, HIDDEN=hidden)


NODE = "pga_me_ros.nodes."
PROGRAM = "pga_me_ros."
NODES = sorted(path.stem for path in Path(nodes.__path__[0]).glob("[a-z]*.py"))


@pytest.mark.parametrize(
    ("hidden", "command", "words"),
    [
        *(
            ("pga_me_msgs", f"{NODE}{name}", "The message package pga_me_msgs is not installed")
            for name in NODES
        ),
        ("pga_me_msgs", f"{PROGRAM}query", "The message package pga_me_msgs is not installed"),
        ("pga_me_msgs", f"{PROGRAM}explorer", "The message package pga_me_msgs is not installed"),
        ("rclpy", f"{PROGRAM}query", "rclpy of ROS 2 is not installed"),
        ("tf2_msgs", f"{NODE}behavior_player", "tf2_msgs of ROS 2 is not installed"),
        (
            "pybullet",
            f"{NODE}evaluator --ros-args -p task:=qd_hopper",
            "PyBullet is not installed (needed for task 'qd_hopper')",
        ),
        (
            "pybullet",
            f"{NODE}behavior_player --ros-args -p run_dir:=RUN",
            "PyBullet is not installed (needed for task 'qd_hopper')",
        ),
        (
            "gymnasium",
            f"{NODE}evaluator --ros-args -p task:=gymnasium:Hopper-v5",
            "Gymnasium is not installed (needed for task 'gymnasium:Hopper-v5')",
        ),
        (
            "mujoco",
            f"{NODE}evaluator --ros-args -p task:=gymnasium:Hopper-v5",
            "MuJoCo is not installed",
        ),
        ("PIL", f"{PROGRAM}render RUN", "Pillow is not installed (needed for pictures)"),
        ("matplotlib", f"{PROGRAM}report RUN", "Matplotlib is not installed"),
        (
            "tensorboard",
            f"{NODE}orchestrator --ros-args -p tensorboard:=true",
            "TensorBoard is not installed (needed for events of tensorboard:=true)",
        ),
        ("onnx", f"{PROGRAM}export RUN --to onnx --best", "onnx is not installed"),
        ("torch", f"{PROGRAM}export RUN --to torchscript --best", "PyTorch is not installed"),
        ("rosbags", f"{NODE}record --ros-args -p bag:=walker", "rosbags is not installed"),
        ("rosbags", f"{PROGRAM}replay walker --out critics", "rosbags is not installed"),
        ("starlette", f"{PROGRAM}explorer RUN", "Starlette is not installed"),
        ("uvicorn", f"{PROGRAM}explorer RUN", "Uvicorn is not installed"),
        ("jupyter_threejs_sage", f"{PROGRAM}explorer RUN", "three.js is not installed"),
    ],
)
def test_a_program_without_a_package_ends_with_one_line(
    hiding, hopper_run: Path, hidden: str, command: str, words: str
) -> None:
    words_of_command = command.replace("RUN", str(hopper_run)).split()
    done = hiding(hidden, sys.executable, "-m", *words_of_command)
    assert done.returncode == EXIT_BAD_INPUT, done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith(f"error: {words}")
    assert "; install it with: " in lines[0]


@pytest.mark.parametrize(
    ("hidden", "task", "words"),
    [
        ("pybullet", "qd_hopper", "PyBullet is not installed"),
        ("gymnasium", "gymnasium:Hopper-v5", "Gymnasium is not installed"),
        ("mujoco", "gymnasium:Hopper-v5", "MuJoCo is not installed"),
    ],
)
def test_the_checker_of_tasks_names_it_as_its_finding(
    hiding, hidden: str, task: str, words: str
) -> None:
    done = hiding(hidden, sys.executable, "-m", "pga_me_ros.tasks.check", task)
    assert (done.returncode, done.stderr) == (1, "")
    (finding,) = done.stdout.splitlines()
    assert finding.startswith(f"{task}: ")
    assert words in finding
    assert "; install it with: " in finding


def test_a_run_without_torch_ends_with_one_line_and_no_restart(hiding, tmp_path: Path) -> None:
    run = f"{NODE}orchestrator --ros-args -p run_dir:={tmp_path / 'run'} -p evaluators:=1"
    done = hiding("torch", sys.executable, "-m", *run.split())
    assert done.returncode == EXIT_BAD_INPUT, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1, done.stderr
    assert "PyTorch is not installed" in errors[0]
    assert "install it with: " in errors[0]
    assert "Traceback" not in done.stderr
    assert "restart" not in done.stderr
    logs = [tmp_path / "run" / "logs" / f"{name}.log" for name in ("critic_trainer", "variation")]
    told = [log.read_text().count("PyTorch is not installed") for log in logs if log.exists()]
    assert max(told) == 1  # whichever comes first ends the run; neither is started twice


def test_an_installed_script_says_it_as_well(hiding) -> None:
    done = hiding("numpy", str(Path(sys.prefix) / "lib/pga_me_ros/report"), "--help")
    assert done.returncode == EXIT_BAD_INPUT
    assert done.stderr.startswith("error: NumPy is not installed; install it with: ")


def test_the_program_of_a_user_keeps_its_traceback(hiding) -> None:
    code = "import pga_me_ros, pybullet"
    done = hiding("pybullet", sys.executable, "-c", code)
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert done.stderr.endswith("ModuleNotFoundError: No module named 'pybullet'\n")


def test_a_missing_module_of_this_package_is_a_fault() -> None:
    assert missing_dependency(ModuleNotFoundError("no", name="pga_me_ros.core.nothing")) is None
    assert missing_dependency(ImportError("no", name="torch")) is None


def test_a_compiled_part_for_another_python_is_told_from_a_missing_package() -> None:
    words = str(missing("rclpy._rclpy_pybind11"))
    assert "ROS 2 was installed for another Python" in words
    assert sys.executable in words


def test_a_package_that_nobody_foresaw_is_named() -> None:
    assert str(missing("servo.driver")) == (
        "The Python package 'servo' is not installed; install it with: pip install servo"
    )


@pytest.fixture
def with_older_messages(tmp_path: Path):
    """Return a function that runs Python where an older build of the messages is found: one lacks a field."""
    older = tmp_path / "older/pga_me_msgs"
    shutil.copytree(Path(pga_me_msgs.__file__).parent, older)
    code = older / "srv/_evaluate.py"
    code.write_text(code.read_text().replace("'exploration_correlation'", "'another_name'"))
    return partial(run_finding, older.parent, sys.executable)


def words_for(build: Path, lacking: str) -> str:
    """Return what is said of a build that lacks something; it is outside of the environment that the setup makes."""
    return (
        f"pga_me_msgs in '{build}' is not of this version: it lacks {lacking}; build it again with: colcon build "
        "--base-paths . msg_defs && . install/setup.bash"
    )


LACKING = f"'exploration_correlation' of {DEFINITIONS}/srv/Evaluate.srv"


@pytest.mark.parametrize("program", [f"{NODE}orchestrator", f"{NODE}evaluator", f"{PROGRAM}query"])
def test_a_program_with_an_older_build_of_the_messages_ends_with_one_line(
    with_older_messages, tmp_path: Path, program: str
) -> None:
    done = with_older_messages("-m", program)
    assert (done.returncode, done.stdout) == (EXIT_BAD_INPUT, "")
    assert done.stderr == f"error: {words_for(tmp_path / 'older/pga_me_msgs', LACKING)}\n"


def test_the_program_of_a_user_learns_of_an_older_build_from_the_error(
    with_older_messages, tmp_path: Path
) -> None:
    done = with_older_messages("-c", "import pga_me_ros.client")
    assert done.returncode == 1
    words = words_for(tmp_path / "older/pga_me_msgs", LACKING)
    assert (
        done.stderr.splitlines()[-1] == f"pga_me_ros.dependencies.MissingDependencyError: {words}"
    )


def test_each_name_of_each_definition_is_looked_for(tmp_path: Path, monkeypatch) -> None:
    definitions = tmp_path / "msg_defs"
    shutil.copytree(DEFINITIONS, definitions)
    monkeypatch.setattr(own_messages, "DEFINITIONS", definitions)
    own_messages.require_same_messages()
    for path, line, lacking in (
        ("msg/Metrics.msg", "float64[<=3] unheard_of", "'unheard_of'"),
        ("msg/NodeStatus.msg", "uint8 UNHEARD_OF=7", "'UNHEARD_OF'"),
        ("srv/GetBehavior.srv", "pga_me_msgs/Controller[] unheard_of  # a comment", "'unheard_of'"),
        ("msg/UnheardOf.msg", "# nothing yet", "UnheardOf"),
    ):
        file = definitions / path
        before = file.read_text() if file.exists() else None
        file.write_text(f"{before or ''}\n# a comment alone\n{line}\n")
        with pytest.raises(
            MissingDependencyError, match=f"lacks {lacking} of {file}; .* make mess"
        ):
            own_messages.require_same_messages()
        file.unlink()
        if before is not None:
            file.write_text(before + "# other words\n")
    own_messages.require_same_messages()
    # What stands next to this package may be another's.
    (definitions / "msg/UnheardOf.msg").touch()
    (definitions / "package.xml").write_text("<package><name>other_msgs</name></package>")
    own_messages.require_same_messages()
    monkeypatch.setattr(own_messages, "DEFINITIONS", tmp_path / "no checkout")
    own_messages.require_same_messages()
