"""PyBullet's banner, which its C library prints, is left out wherever a task is loaded; all else is shown."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "my_robot"


def errors_of(program: str, *folders: Path) -> str:
    path = os.pathsep.join([*map(str, folders), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.parametrize("task", ["qd_hopper", "my_task:Crawler"])
def test_nothing_is_printed_when_a_robot_is_loaded(task: str) -> None:
    program = f"from pga_me_ros.tasks.registry import make_task; make_task({task!r}).close()"
    assert errors_of(program, EXAMPLE) == ""


def test_what_else_is_printed_meanwhile_is_shown(tmp_path: Path) -> None:
    (tmp_path / "pybullet.py").write_text(
        "import os\nos.write(2, b'pybullet build time: Jan 29 2025\\nno OpenGL\\n')\nvalue = 7\n"
    )
    program = "import pga_me_ros.tasks.registry, pybullet, os; os.write(2, b'%d' % pybullet.value)"
    assert errors_of(program, tmp_path) == "no OpenGL\n7"


def test_an_import_that_fails_says_why(tmp_path: Path) -> None:
    (tmp_path / "pybullet.py").write_text("raise ImportError('built for another Python')\n")
    program = (
        "import pga_me_ros.tasks.registry, sys\n"
        "try:\n"
        "    import pybullet\n"
        "except ImportError as error:\n"
        "    print(error, file=sys.stderr)\n"
    )
    assert errors_of(program, tmp_path) == "built for another Python\n"


def test_it_works_without_standard_error() -> None:
    program = "import os, pga_me_ros.tasks.registry; os.close(2); import pybullet"
    assert errors_of(program) == ""
