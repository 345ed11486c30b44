"""The checker finds what is wrong with a task, and nothing in valid ones."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import broken_tasks
import pytest

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.check import check_task, main
from pga_me_ros.tasks.registry import BUILT_IN, load_task, make_task


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_built_in_tasks_follow_the_protocol(name: str) -> None:
    assert check_task(load_task(name)) == []


@pytest.mark.parametrize(
    "name",
    ["Point", "Diverges", "TellsItsSide", "TellsItsSideLate", "SameArrays", "HugeRewardAtTheEnd"],
)
def test_valid_task_has_no_findings(name: str) -> None:
    assert check_task(getattr(broken_tasks, name)) == []


@pytest.mark.parametrize(
    ("name", "finding"),
    [
        ("NoSpec", "'spec' is missing"),
        ("NoDescriptor", "method 'descriptor' is missing"),
        ("StartRaises", "RuntimeError: no simulator here"),
        ("ResetRaises", "reset(rng) raised KeyError"),
        ("DoubleObservation", "dtype float64; expected a finite (2,) float32 array"),
        ("LongObservation", "shape (3,)"),
        ("NanObservation", "holds NaN"),
        ("GymStep", "expected (observation, reward, terminated)"),
        ("NumpyReward", "reward is numpy.float64"),
        ("NumpyTerminated", "terminated is numpy.bool; expected bool"),
        ("WideDescriptor", "the spec says 0.0 to 1.0"),
        ("TellsSomethingElse", "not the mean of the observation entries ['position']"),
        ("RemembersPose", "after others had run"),
        ("SharedState", "in two tasks of one process"),
        ("LateNan", "left the finite numbers"),
        ("TakesNan", "accepted an action of NaN"),
        ("WrongErrorForNan", "raise NonFiniteActionError"),
        ("SpoiltByNan", "changed the episodes after it"),
        ("SameArrayThatRemembers", "after others had run"),
        ("HugeReward", "step's reward is 1e+39; expected a finite number within"),
        ("LateHugeReward", "its reward in step 20 is 1e+39"),
        ("NanDescriptor", "gave the descriptor [nan]"),
        ("FailsLate", "RuntimeError: buffer is full"),
        ("ShortObservation", "observation of shape (1,) in step 5"),
        ("StartExits", "__init__() raised SystemExit: no license"),
        ("StepExits", "called sys.exit(0)"),
        ("CloseExits", "close() raised SystemExit"),
        ("ClosesOnce", "a second close() raised"),
    ],
)
def test_the_fault_of_a_broken_task_is_reported(name: str, finding: str) -> None:
    findings = check_task(getattr(broken_tasks, name))
    assert any(finding in text for text in findings), findings


def test_instance_instead_of_class_is_reported() -> None:
    assert "not a class" in check_task(broken_tasks.Point())[0]


def test_command_line_names_findings_and_fails() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "pga_me_ros.tasks.check", "broken_tasks:Point", "qd_wlker"],
        cwd=Path(__file__).parents[2],
        env={"PYTHONPATH": str(Path(__file__).parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    lines = result.stdout.splitlines()
    assert lines[0] == "broken_tasks:Point: follows the task protocol"
    assert "did you mean 'qd_walker'?" in lines[1]


def test_module_that_exits_while_it_loads_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "exits_at_once.py").write_text("raise SystemExit(0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["exits_at_once:Task"]) == 1
    assert "does not load (SystemExit: 0)" in capsys.readouterr().out


def test_task_that_exits_when_it_starts_is_reported() -> None:
    with pytest.raises(TaskError, match=r"does not start \(SystemExit: no license\)"):
        make_task("broken_tasks:StartExits")


@pytest.mark.parametrize(("arguments", "code"), [([], 2), (["--help"], 0), (["-h"], 0)])
def test_the_usage_is_shown_on_request_and_without_a_task(
    arguments: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr()
    assert ended.value.code == code
    assert "usage: python -m pga_me_ros.tasks.check [-h] TASK" in said.out + said.err
    assert "unknown task" not in said.out
