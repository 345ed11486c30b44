"""The steps of the setup; setup_venv.py decides which of them are due.

Only the standard library is used, because this runs before anything is installed.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
LOG = VENV / "setup.log"
BUILDS = VENV / "build"
# With the wheels, CMake needs this for every interface package.
CMAKE_FOR_WHEELS = f"-DCMAKE_PROJECT_INCLUDE={ROOT / 'scripts' / 'interface_packages.cmake'}"
REQUIREMENTS = ("run.txt", "build.txt", "web.txt", "test.txt")
PYBULLET_WHEELS = ((3, 11),)
"""Supported versions of Python for which PyBullet has wheels; elsewhere it is built from source."""

WHEELS = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pga_me_ros" / "wheels"
"""Where wheels that were built here are kept, for later setups of any checkout."""

LOG_LINES_SHOWN = 10
BOOTSTRAP_GUARD = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


class SetupError(Exception):
    """The setup cannot continue; the message says why and what to do."""


def clean_environment() -> dict[str, str]:
    """Return the environment for tools: .venv first, nothing from another Python, workspace or make."""
    environment = dict(os.environ)
    # If its guard is set, the wheels' bootstrap trusts LD_LIBRARY_PATH; both may be another venv's.
    if environment.pop(BOOTSTRAP_GUARD, None):
        environment.pop("LD_LIBRARY_PATH", None)
    for name in (
        "PYTHONPATH",
        "PYTHONHOME",
        "MAKEFLAGS",
        "MFLAGS",
        "MAKELEVEL",
        "CMAKE_GENERATOR",
        "DESTDIR",
    ):
        environment.pop(name, None)
    environment["VIRTUAL_ENV"] = str(VENV)
    environment["PATH"] = f"{VENV / 'bin'}{os.pathsep}{environment.get('PATH', os.defpath)}"
    environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = str(VENV)
    return environment


def telling_lines(output: list[str]) -> list[str]:
    """Return the first lines that mention an error (a parallel build buries them), else the last lines."""
    errors = [line for line in output if re.search(r"\berror\b", line, re.IGNORECASE)]
    return errors[:LOG_LINES_SHOWN] or output[-LOG_LINES_SHOWN:]


def run_logged(*command: str | Path, cwd: Path = ROOT) -> None:
    """Run a command and log its output.

    Raises:
        SetupError: The command failed; the message has the end of its output.
    """
    VENV.mkdir(exist_ok=True)
    with LOG.open("a") as log:
        began = log.tell()
        print(f"\n$ {' '.join(map(str, command))}", file=log, flush=True)
        result = subprocess.run(
            [str(word) for word in command],
            cwd=cwd,
            env=clean_environment(),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            check=False,
        )
    if result.returncode:
        output = LOG.read_bytes()[began:].decode(errors="replace").splitlines()
        raise SetupError(
            "\n".join([*telling_lines(output), f"error: setup failed; the whole log is {LOG}"])
        )


def base_python() -> str:
    """Return the interpreter that venvs are made from, even if .venv's python runs this."""
    return getattr(sys, "_base_executable", sys.executable)


def create_venv() -> None:
    """Make .venv, or repair the existing one."""
    run_logged(base_python(), "-m", "venv", VENV)


def is_of_another_python() -> bool:
    """Return whether .venv was made with another minor version of Python than the one that runs this."""
    settings = VENV / "pyvenv.cfg"
    found = (
        re.search(r"^version\s*=\s*(\d+\.\d+)", settings.read_text(), re.M)
        if settings.is_file()
        else None
    )
    return found is not None and found[1] != f"{sys.version_info.major}.{sys.version_info.minor}"


def install_requirements() -> None:
    """Install the pinned dependencies; one pip call, so that it finds any conflict among them."""
    pins = [word for name in REQUIREMENTS for word in ("-r", f"requirements/{name}")]
    if sys.version_info[:2] not in PYBULLET_WHEELS:
        keep_pybullet_wheel()
        pins += ["--find-links", str(WHEELS)]
    run_pip("install", *pins)


def keep_pybullet_wheel() -> None:
    """Build PyBullet from its source, unless an earlier setup kept the wheel.

    It is built in .venv, not in isolation, because PyBullet returns arrays only if NumPy is present when it is built.
    """
    pybullet, numpy, setuptools, wheel = (
        pin(name) for name in ("pybullet", "numpy", "setuptools", "wheel")
    )
    version = pybullet.partition("==")[2]
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    if any(WHEELS.glob(f"pybullet-{version}-{tag}-*.whl")):
        return
    print(
        f"pga_me_ros: building PyBullet from source, as it has no wheel for Python {sys.version_info.major}."
        f"{sys.version_info.minor}: some 10 minutes of processor time, once; the wheel is kept in {WHEELS}",
        flush=True,
    )
    run_pip("install", numpy, setuptools, wheel)
    WHEELS.mkdir(parents=True, exist_ok=True)
    run_pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", WHEELS, pybullet)


def pin(name: str) -> str:
    """Return the line of requirements/ that pins a package, without its comment."""
    for file in REQUIREMENTS:
        for line in (ROOT / "requirements" / file).read_text().splitlines():
            if line.startswith(f"{name}=="):
                return line.partition("#")[0].strip()
    raise SetupError(f"error: requirements/ has no pin of {name}; restore its files")


def run_pip(*words: str | Path) -> None:
    """Run pip in .venv."""
    python = VENV / "bin/python"
    run_logged(
        python, "-m", "pip", words[0], "--no-input", "--disable-pip-version-check", *words[1:]
    )


def build_messages() -> None:
    """Build and install the message package."""
    build_interfaces(ROOT / "msg_defs", BUILDS / "pga_me_msgs")


def build_tf2_msgs() -> None:
    """Build and install the message type of /tf, for which there is no wheel."""
    build_interfaces(ROOT / "scripts" / "tf2_msgs", BUILDS / "tf2_msgs")


def build_interfaces(source: Path, build: Path) -> None:
    """Build and install an interface package from scratch, after removing what its last build installed."""
    manifest = build / "install_manifest.txt"
    if manifest.is_file():
        for line in manifest.read_text().splitlines():
            Path(line).unlink(missing_ok=True)
    shutil.rmtree(build, ignore_errors=True)
    cmake = VENV / "bin/cmake"
    run_logged(
        cmake, "-S", source, "-B", build, "-G", "Unix Makefiles",
        f"-DCMAKE_INSTALL_PREFIX={VENV}",
        f"-DPython3_EXECUTABLE={VENV / 'bin/python3'}",
        CMAKE_FOR_WHEELS,
        "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF",
    )  # fmt: skip
    run_logged(cmake, "--build", build, "--parallel", str(os.cpu_count() or 1))
    run_logged(cmake, "--install", build)


def install_package() -> None:
    """Make the checkout importable, and install what ROS looks for into the prefix."""
    python = VENV / "bin/python"
    run_logged(
        python, "-m", "pip", "install", "--no-deps", "--no-build-isolation", "--editable", "."
    )
    # An editable install omits the data files.
    run_logged(python, "setup.py", "--quiet", "install_data", "--force", f"--install-dir={VENV}")
    shutil.copy(ROOT / "scripts/setup.bash", VENV / "setup.bash")
    defaults = {"build": {"cmake-args": [CMAKE_FOR_WHEELS]}}
    (VENV / "colcon_defaults.yaml").write_text(json.dumps(defaults))  # JSON is YAML


def check_machine() -> None:
    """Check for tools that cannot be installed from here.

    Raises:
        SetupError: A tool or the Python headers are missing.
    """
    for tool, variable, names in (
        ("C compiler", "CC", ("cc", "gcc", "clang")),
        ("C++ compiler", "CXX", ("c++", "g++", "clang++")),
        ("make", "", ("make", "gmake")),
    ):
        chosen = os.environ.get(variable, "").split()[:1]
        if not any(shutil.which(name) for name in chosen or names):
            missing = (
                f"{variable}={chosen[0]} does not exist"
                if chosen
                else f"no {tool} ({', '.join(names)}) on PATH"
            )
            raise SetupError(
                f"error: {missing}; the message package needs one: install gcc, g++ and make"
            )
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        raise SetupError(f"error: {base_python()} lacks Python.h; install its development package")
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        raise SetupError(
            f"error: {base_python()} lacks the venv module; install its venv package"
        ) from None
