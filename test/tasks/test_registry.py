"""Names of tasks, and what loading them costs."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
from broken_tasks import Point

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.registry import BUILT_IN, load_task, simulation_versions, task_spec

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("name", "dimensions", "cells"),
    [
        ("qd_walker", (22, 6, 2), 1024),
        ("qd_half_cheetah", (26, 6, 2), 1024),
        ("qd_ant", (28, 8, 4), 1296),
        ("qd_hopper", (15, 3, 1), 1000),
    ],
)
def test_built_in_tasks_have_the_papers_sizes(name: str, dimensions: tuple, cells: int) -> None:
    spec = task_spec(name)
    assert (spec.observation_dim, spec.action_dim, spec.descriptor_dim) == dimensions
    assert (spec.name, spec.max_steps, spec.archive_cells) == (name, 1000, cells)


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_reading_a_spec_starts_no_simulator(name: str) -> None:
    code = (
        "import sys; from pga_me_ros.tasks.registry import task_spec;"
        f"task_spec({name!r});"
        "print([m for m in ('pybullet', 'torch', 'rclpy') if m in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


def test_own_task_is_loaded_by_module_and_class() -> None:
    assert load_task("broken_tasks:Point") is Point


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("qd_wlker", "(did you mean 'qd_walker'?)"),
        ("walking", "built-in tasks are qd_walker, qd_half_cheetah, qd_ant, qd_hopper"),
        ("", "module.path:Class"),
        ("no_such_module:Task", "'no_such_module' does not load"),
        (":Task", "does not load"),
        ("broken_tasks:Pont", "no class 'Pont' (did you mean 'Point'?)"),
        ("broken_tasks:", "no class ''"),
        ("broken_tasks:SPEC", "no class 'SPEC'"),
        ("broken_tasks:NoSpec", "'spec' that is a TaskSpec"),
    ],
)
def test_the_error_for_a_wrong_name_says_what_is_wrong(name: str, message: str) -> None:
    with pytest.raises(TaskError) as caught:
        load_task(name)
    assert message in str(caught.value)


def test_module_that_fails_to_load_is_named_with_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "task_with_a_bug.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(TaskError, match="ZeroDivisionError"):
        load_task("task_with_a_bug:Task")


def test_versions_tell_another_revision_of_a_task_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, task = simulation_versions("qd_hopper"), load_task("qd_hopper")
    assert ours == simulation_versions("qd_hopper")
    monkeypatch.setattr(task, "spec", dataclasses.replace(task.spec, max_steps=999))
    *same, spec = simulation_versions("qd_hopper").split(", ")
    assert same == ours.split(", ")[:-1]
    assert spec.startswith("task spec ")
    assert spec not in ours


def test_versions_name_what_results_depend_on() -> None:
    python = f"python {sys.version_info.major}.{sys.version_info.minor}"
    assert simulation_versions("qd_walker").split(", ")[0] == python
    assert "pybullet 3.2.7" in simulation_versions("qd_walker")
    assert "mujoco" not in simulation_versions("qd_walker")
    assert "mujoco 3.3.7" in simulation_versions("gymnasium:Ant-v5")
    assert "no " not in simulation_versions("gymnasium:Ant-v5")
