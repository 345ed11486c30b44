"""Notes when each part of a process's start begins and ends. Not a bench itself.

`bench/startup.py` puts this folder on PYTHONPATH, so that Python loads this module before anything else. It wraps a few
modules and functions as they are loaded; what a revision of the package lacks is left out. Each process appends its
marks to a file of its own in the folder `STARTUP_MARKS`, one JSON object per line.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import time
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

FOLDER = "STARTUP_MARKS"

LIBRARIES = ("numpy", "rclpy", "torch", "pybullet", "mujoco", "pga_me_msgs.srv")
"""Libraries whose import is timed."""

FUNCTIONS = {
    "rclpy": ("init",),
    "pga_me_ros.process.child": ("ChildProcess.__init__",),
    "pga_me_ros.process.parent_watch": ("wait_for_word",),
    "pga_me_ros.ros.graph_node": ("GraphNode.__init__", "GraphNode.start_heartbeat"),
    "pga_me_ros.orchestration.control": ("Control.__init__",),
    "pga_me_ros.orchestration.free_name": ("require_free_name",),
    "pga_me_ros.orchestration.run": ("Run.grow",),
    "pga_me_ros.orchestration.generation": ("GenerationLoop.run",),
    "pga_me_ros.core.runs.run_directory": ("open_run",),
    "pga_me_ros.core.archive.cvt": ("cvt_centroids",),
    "pga_me_ros.core.variation.make_offspring": ("make_offspring",),
    "pga_me_ros.tasks.registry": ("make_task",),
    "pga_me_ros.tasks.rollout": ("rollout",),
}
"""Functions that are timed, by module; only the first call of each counts."""


def now() -> float:
    """Return the time since the machine's start, s: the same clock in all processes."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Marks:
    """The marks of this process."""

    def __init__(self, folder: str) -> None:
        self._path = os.path.join(folder, f"{os.getpid()}.jsonl")
        self._noted: set[str] = set()

    def note(self, part: str, began: float, ended: float) -> None:
        """Note when a part began and ended, and the core seconds that this process has used by now."""
        if part in self._noted:
            return
        self._noted.add(part)
        mark = {"part": part, "began": began, "ended": ended, "core": time.process_time()}
        with open(self._path, "a") as file:
            file.write(json.dumps(mark) + "\n")

    def timed(self, part: str, function: Any) -> Any:
        """Return a function that notes its first call."""

        @functools.wraps(function)
        def call(*args: Any, **options: Any) -> Any:
            began = now()
            if part not in self._noted:
                self.note(f"{part} begins", began, began)
            try:
                return function(*args, **options)
            finally:
                self.note(part, began, now())

        return call


class TimingLoader(Loader):
    """Loads a module, notes how long that took, and wraps its functions."""

    def __init__(self, loader: Any, marks: Marks) -> None:
        self._loader = loader
        self._marks = marks

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Return the module that the actual loader makes."""
        made: ModuleType | None = self._loader.create_module(spec)
        return made

    def exec_module(self, module: ModuleType) -> None:
        """Load the module."""
        began = now()
        self._loader.exec_module(module)
        if module.__name__ in LIBRARIES:
            self._marks.note(f"import {module.__name__}", began, now())
        for path in FUNCTIONS.get(module.__name__, ()):
            *owners, name = path.split(".")
            owner = functools.reduce(lambda at, part: getattr(at, part, None), owners, module)
            if hasattr(owner, name):
                setattr(owner, name, self._marks.timed(path, getattr(owner, name)))

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute of the actual loader."""
        return getattr(self._loader, name)


class TimingFinder(MetaPathFinder):
    """Finds the modules that are timed."""

    def __init__(self, marks: Marks) -> None:
        self._marks = marks

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a module's spec with a loader that times it, None for any other module."""
        if name not in LIBRARIES and name not in FUNCTIONS:
            return None
        for finder in sys.meta_path:
            if finder is not self:
                spec = finder.find_spec(name, path, target)
                if spec is not None:
                    if spec.loader is not None:
                        spec.loader = TimingLoader(spec.loader, self._marks)
                    return spec
        return None


def process_began() -> float:
    """Return when this process was started, to 10 ms."""
    with open("/proc/self/stat") as file:
        ticks = int(file.read().rsplit(")", 1)[1].split()[19])
    return ticks / os.sysconf("SC_CLK_TCK")


if os.environ.get(FOLDER):
    _marks = Marks(os.environ[FOLDER])
    _marks.note("interpreter", process_began(), now())
    sys.meta_path.insert(0, TimingFinder(_marks))
