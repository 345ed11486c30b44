"""Which modules import ROS, and which processes stay light."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

REPORT = """
import importlib, json, sys
for name in json.loads(sys.argv[1]):
    importlib.import_module(name)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def packages_loaded_by(modules: list[str]) -> set[str]:
    """Return the top-level packages in a fresh process after it imported the modules."""
    result = subprocess.run(
        [sys.executable, "-c", REPORT, json.dumps(modules)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return set(json.loads(result.stdout))


def modules_below(folder: str) -> list[str]:
    """Return the names of all modules of a package of the checkout."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]
    return [name.removesuffix(".__init__") for name in names]


@pytest.mark.parametrize("folder", ["pga_me_ros/core", "pga_me_ros/tasks"])
def test_core_and_tasks_do_not_import_ros(folder: str) -> None:
    modules = modules_below(folder)
    assert len(modules) > 1
    loaded = packages_loaded_by(modules)
    assert not {name for name in loaded if name == "rclpy" or name.endswith("_msgs")}


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("pga_me_ros.nodes.evaluator", {"torch"}),
        ("pga_me_ros.nodes.adapter", {"torch", "pybullet"}),
        ("pga_me_ros.nodes.controller", {"torch", "pybullet"}),
        ("pga_me_ros.nodes.archive_manager", {"torch", "pybullet"}),
        ("pga_me_ros", {"numpy", "torch", "pybullet", "rclpy"}),
        ("pga_me_ros.library", {"torch", "pybullet", "rclpy", "PIL", "pandas"}),
        ("pga_me_ros.core.settings", {"torch", "pybullet", "rclpy"}),
        ("pga_me_ros.client", {"torch", "pybullet"}),
        ("pga_me_ros.nodes.behavior_player", {"torch", "pybullet", "PIL"}),
        ("pga_me_ros.render.__main__", {"torch", "pybullet", "PIL", "rclpy"}),
        ("pga_me_ros.nodes.record", {"torch", "pybullet", "rosbags"}),
        ("pga_me_ros.replay.__main__", {"torch", "pybullet", "rosbags"}),
        ("pga_me_ros.tasks.registry", {"torch", "pybullet"}),
    ],
)
def test_light_modules_stay_light(module: str, heavy: set[str]) -> None:
    assert not packages_loaded_by([module]) & heavy
