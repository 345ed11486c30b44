"""A run continues when its output is lost: a closed stream, a full device, a terminal that is gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from graph import TINY, Graph, ros_arguments, wait_until
from processes import children
from reference import run_digest, search_digest

ORCHESTRATOR = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator"]


def command(run_dir: Path, **parameters: Any) -> list[str]:
    return [*ORCHESTRATOR, *ros_arguments({**TINY, "run_dir": run_dir, **parameters})]


def log(run_dir: Path) -> str:
    path = run_dir / "logs" / "orchestrator.log"
    return path.read_text() if path.exists() else ""


@pytest.mark.parametrize(
    "redirections", ["<&- >&- 2>&-", ">/dev/full 2>&1"], ids=["closed", "full"]
)
def test_a_run_without_output_ends_like_any_other(
    graph: Graph, tmp_path: Path, redirections: str
) -> None:
    run_dir = tmp_path / "run"
    script = f'trap "" HUP; "$@" {redirections}; echo "ended with $?" >&3'
    with (tmp_path / "status").open("wb") as status:
        run = subprocess.Popen(
            ["bash", "-c", f"exec 3>&1; {script}", "bash", *command(run_dir)],
            stdout=status,
            stderr=status,
            env=graph.environment,
        )
        run.wait(120)
    assert (tmp_path / "status").read_text().splitlines()[-1] == "ended with 0"
    assert "Traceback" not in (tmp_path / "status").read_text()
    assert "generation 3/3" in log(run_dir)
    assert "finished: " in log(run_dir)
    assert run_digest(run_dir) == search_digest()


@pytest.mark.parametrize("closed", ["terminal", "reader"])
def test_a_run_that_ignores_a_hangup_outlives_its_terminal_and_its_reader(
    graph: Graph, tmp_path: Path, closed: str
) -> None:
    run_dir = tmp_path / "run"
    ours, theirs = os.openpty() if closed == "terminal" else os.pipe()
    run = subprocess.Popen(
        ["bash", "-c", 'trap "" HUP; exec "$@"', "bash", *command(run_dir, evaluations=100_000)],
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
        env=graph.environment,
        start_new_session=True,
        cwd=tmp_path,
    )
    os.close(theirs)
    try:
        wait_until(lambda: "generation 2/" in log(run_dir), "the run")
        os.close(ours)
        at = log(run_dir).count("generation")

        def goes_on() -> bool:
            assert run.poll() is None, log(run_dir)
            return log(run_dir).count("generation") > at + 2

        wait_until(goes_on, "more generations")
        assert log(run_dir).count("standard output cannot be written to") == 1
        run.send_signal(signal.SIGTERM)
        assert run.wait(30) == 0
        assert "the same command resumes" in log(run_dir)
        assert not children(run_dir)
    finally:
        run.kill()
        run.wait()


@pytest.mark.parametrize("redirections", [">&- 2>&-", ">/dev/full 2>/dev/full", "| true"])
@pytest.mark.parametrize(
    ("program", "code"),
    [("nodes.archive_manager --help", 0), ("nodes.archive_manager", 2), ("report nowhere", 2)],
)
def test_programs_exit_with_their_status_wherever_their_output_goes(
    graph: Graph, tmp_path: Path, program: str, code: int, redirections: str
) -> None:
    script = f"{sys.executable} -m pga_me_ros.{program} {redirections}"
    ended = subprocess.run(
        ["bash", "-c", f'{script}; echo "${{PIPESTATUS[0]}}"'],
        env=graph.environment,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert ended.stdout.split() == [str(code)]
    assert "Exception" not in ended.stderr
    assert "Traceback" not in ended.stderr


def test_no_file_gets_the_number_of_a_closed_stream(tmp_path: Path) -> None:
    # Output of libraries, such as PyBullet's greeting, would go into that file.
    code = (
        "import os, pga_me_ros.nodes\n"
        "number = os.open('file', os.O_CREAT | os.O_WRONLY)\n"
        "os.write(1, b'banner'); os.write(2, b'warning')\n"
        "os._exit(number)"
    )
    ended = subprocess.run(
        ["bash", "-c", '"$@" <&- >&- 2>&-', "bash", sys.executable, "-c", code], cwd=tmp_path
    )
    assert ended.returncode > 2
    assert (tmp_path / "file").read_bytes() == b""
