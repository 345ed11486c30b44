"""Progress of a run: on its topic, in a terminal, and in a file."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest
from graph import TINY, Graph, Probe, ros_arguments, wait_until
from pga_me_msgs.msg import Progress
from pga_me_msgs.srv import GetInfo
from processes import kill_child
from screen import Terminal
from std_srvs.srv import Trigger

from pga_me_ros.ros import names, qos

ENDLESS = 10**7
NARROW = 60


def test_the_topic_reports_pause_and_stop(graph: Graph, probe: Probe, tmp_path: Path) -> None:
    heard: list[Progress] = probe.listen(Progress, names.PROGRESS, qos.EXPERIENCE_READER)
    run = graph.run(tmp_path / "run", evaluations=ENDLESS)
    for service, state in {"pause": "paused", "resume": "running", "stop": "stopping"}.items():
        wait_until(lambda: bool(heard) and heard[-1].generation >= 0, "a generation")
        assert probe.call(GetInfo, names.GET_INFO).growing
        assert probe.call(Trigger, f"/orchestrator/{service}").success
        wait_until(lambda state=state: heard[-1].state == state, state)
    assert run.wait() == 0, run.output
    assert "the same command resumes" in run.output


def test_the_topic_reports_failure(
    graph: Graph, probe: Probe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_robots.py").write_text(
        "from pga_me_ros.tasks.bullet.locomotion import QDHopper\n"
        "class Unplugged(QDHopper):\n"
        "    def __init__(self):\n"
        "        raise RuntimeError\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    heard: list[Progress] = probe.listen(Progress, names.PROGRESS, qos.EXPERIENCE_READER)
    run = graph.run(tmp_path / "run", task="my_robots:Unplugged")
    assert run.wait() == 2, run.output
    wait_until(lambda: heard[-1].state == "failed", "the last state")


def test_in_a_terminal_progress_stays_in_one_intact_line(graph: Graph, tmp_path: Path) -> None:
    values = {**TINY, "run_dir": tmp_path / "run", "evaluations": ENDLESS}
    command = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator", *ros_arguments(values)]
    terminal = Terminal(command, NARROW, graph.environment, tmp_path)

    def shown(text: str) -> bool:
        assert terminal.process.poll() is None, terminal.rows
        return any(row.startswith(text) for row in terminal.rows)

    try:
        wait_until(lambda: shown("qd_walker  evaluations"), "progress")
        kill_child(tmp_path / "run", "evaluator_0")
        wait_until(lambda: shown("[WARN]"), "a warning")
        wait_until(lambda: terminal.rows[-1].startswith("qd_walker"), "progress below it")
        terminal.process.send_signal(signal.SIGINT)
        terminal.process.wait()
    finally:
        terminal.close()
    progress = [row for row in terminal.rows if "qd_walker  evaluations" in row]
    assert len(progress) == 1, terminal.rows
    assert progress[0].startswith("qd_walker  evaluations")
    assert len(progress[0]) < NARROW
    after = terminal.rows[terminal.rows.index(progress[0]) + 1]
    assert after.startswith("stopped: "), terminal.rows


def test_a_reader_that_exits_ends_the_run_quietly(graph: Graph, tmp_path: Path) -> None:
    values = {**TINY, "run_dir": tmp_path / "run", "evaluations": ENDLESS}
    command = [sys.executable, "-m", "pga_me_ros.nodes.orchestrator", *ros_arguments(values)]
    script = '"$@" | head -2; echo "ended with ${PIPESTATUS[0]}"'
    run = graph.launch(["bash", "-c", script, "bash", *command])
    run.wait()
    assert "Traceback" not in run.output
    assert run.output.splitlines()[-1] == f"ended with {128 + signal.SIGPIPE}"
