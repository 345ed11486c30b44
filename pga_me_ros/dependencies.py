"""What to do about a Python package that is not installed: the one place that says it, for every program and node."""

from __future__ import annotations

import importlib
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, TracebackType
from typing import NamedTuple

from pga_me_ros.errors import PgaError

EXIT_BAD_INPUT = 2
"""Exit status of a program that cannot do what it was asked to do, and would not the next time either."""


class Package(NamedTuple):
    """Where a Python package comes from.

    Attributes:
        title: Its name in a sentence.
        pip: What pip installs it from; empty if pip has no such package.
        apt: Ubuntu's package; empty if there is none.
        purpose: What needs it; empty for all programs.
    """

    title: str
    pip: str
    apt: str
    purpose: str = ""


WEB = "jupyter-threejs-sage==130 starlette uvicorn"
"""What pip installs for the explorer."""

PACKAGES = {
    "PIL": Package("Pillow", "pillow", "python3-pil", "pictures"),
    "gymnasium": Package("Gymnasium", "gymnasium[mujoco]", "", "tasks named gymnasium:..."),
    "imageio": Package("imageio", "gymnasium[mujoco]", "", "tasks with MuJoCo"),
    "jupyter_threejs_sage": Package("three.js", WEB, "", "the explorer"),
    "matplotlib": Package("Matplotlib", "matplotlib", "python3-matplotlib", "curves and pictures"),
    "mujoco": Package("MuJoCo", "gymnasium[mujoco]", "", "tasks with MuJoCo"),
    "numpy": Package("NumPy", "numpy", "python3-numpy"),
    "onnx": Package("onnx", "onnx", "python3-onnx", "export to ONNX"),
    "pandas": Package("pandas", "pandas", "python3-pandas", "tables"),
    "pybullet": Package("PyBullet", "pybullet", "", "the simulated robots"),
    "pybullet_data": Package("PyBullet", "pybullet", "", "the simulated robots"),
    "rosbags": Package("rosbags", "rosbags", "", "recordings"),
    "scipy": Package("SciPy", "scipy", "python3-scipy", "p-values"),
    "starlette": Package("Starlette", WEB, "", "the explorer"),
    "tensorboard": Package("TensorBoard", "tensorboard", "", "events of tensorboard:=true"),
    "torch": Package("PyTorch", "torch", "python3-torch", "critics and policy gradients"),
    "uvicorn": Package("Uvicorn", WEB, "", "the explorer"),
    "yaml": Package("PyYAML", "pyyaml", "python3-yaml"),
}
"""By the name that is imported: what does not come with Python."""

ROS_PACKAGES = {
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "rosidl_runtime_py",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
}
"""What comes with ROS 2, by the name that is imported."""

OWN_MESSAGES = "pga_me_msgs"

BUILD = "colcon build --base-paths . msg_defs && . install/setup.bash"
"""What builds both packages in a checkout."""


class MissingDependencyError(PgaError):
    """A Python package that a feature needs is not installed, or another build of it is."""


def missing(name: str, purpose: str = "") -> MissingDependencyError:
    """Return the error that says in one line which package is missing and which command installs it.

    Args:
        name: Module that could not be imported, such as ``matplotlib.figure``.
        purpose: What needs it; empty for what `PACKAGES` says.
    """
    root = name.partition(".")[0]
    if root == OWN_MESSAGES:
        return _error("The message package pga_me_msgs", purpose, _in_setup(BUILD))
    if root in ROS_PACKAGES:
        if root != name:  # the package is there, its compiled part is not
            return MissingDependencyError(
                f"'{name}' does not exist for {sys.executable}, a Python {sys.version_info.major}."
                f"{sys.version_info.minor}: ROS 2 was installed for another Python; use that one, on Ubuntu 24.04 "
                "/usr/bin/python3 or a virtual environment made with it."
            )
        apt = f"sudo apt install ros-jazzy-{root.replace('_', '-')} && . /opt/ros/jazzy/setup.bash"
        return _error(f"{root} of ROS 2", purpose, _in_setup(apt))
    package = PACKAGES.get(root, Package(f"The Python package '{root}'", root, ""))
    return _error(package.title, purpose or package.purpose, _command(package))


def outdated(name: str, build: Path, difference: str) -> MissingDependencyError:
    """Return the error that says in one line that a package is of another version and which command builds it again.

    Args:
        name: The package.
        build: Where it is imported from.
        difference: What is wrong with it.
    """
    in_setup = Path(sys.prefix) in build.parents
    command = _in_setup(BUILD, "make messages") if in_setup else BUILD
    return MissingDependencyError(
        f"{name} in '{build}' is not of this version: {difference}; build it again with: {command}"
    )


def imported(*names: str, purpose: str = "") -> ModuleType:
    """Import modules of a package that not everybody has.

    Args:
        names: The package, and those of its modules that are needed.
        purpose: As in `missing`.

    Returns:
        The package.

    Raises:
        MissingDependencyError: It is not installed.
    """
    try:
        package, *_ = [importlib.import_module(name) for name in names]
    except ModuleNotFoundError as error:
        raise missing(error.name or names[0], purpose) from None
    return package


def require_installed(*names: str) -> None:
    """Make sure that packages are installed, without importing them.

    Raises:
        MissingDependencyError: One of them is not.
    """
    for name in names:
        if find_spec(name) is None:
            raise missing(name)


def missing_dependency(error: BaseException) -> MissingDependencyError | None:
    """Return the error in one line for an import that failed because a package is missing, else None.

    Args:
        error: Any exception; a missing module of this package is a fault and no missing dependency.
    """
    if isinstance(error, MissingDependencyError):
        return error
    if not isinstance(error, ModuleNotFoundError) or not error.name:
        return None
    root = error.name.partition(".")[0]
    return None if root == __package__ else missing(error.name)


def report_missing_dependencies() -> None:
    """Let this process end with one line, not a traceback, if an import fails because a package is missing.

    For this package's own programs: the program of a user keeps its tracebacks.
    """
    sys.excepthook = _report


def _report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    found = missing_dependency(error)
    if found is None:
        sys.__excepthook__(kind, error, trace)
        return
    print(f"error: {found}", file=sys.stderr, flush=True)
    raise SystemExit(EXIT_BAD_INPUT)


def _error(title: str, purpose: str, command: str) -> MissingDependencyError:
    needed = f" (needed for {purpose})" if purpose else ""
    return MissingDependencyError(f"{title} is not installed{needed}; install it with: {command}")


def _in_setup(command: str, there: str = "rm -r .venv && make setup") -> str:
    """Return the command, or in an environment that scripts/setup.sh made the one that mends it, there."""
    return there if (Path(sys.prefix) / ".stamps").is_dir() else command


def _command(package: Package) -> str:
    """Return the command that installs a package here: Ubuntu wants its own Python's packages to come from apt."""
    managed = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED").is_file()
    pip = f"'{package.pip}'" if "[" in package.pip else package.pip
    if not managed or sys.prefix != sys.base_prefix:
        return f"pip install {pip}"
    if package.apt:
        return f"sudo apt install {package.apt}"
    return f"pip install --break-system-packages {pip}"
