"""Bring .venv up to date: environment, pinned dependencies, message package, this package.

Each step leaves a stamp in .venv/.stamps with a digest of what it depends on, and runs again only when that changes. While a
step runs its stamp says so; a step that was cut off is therefore known, and what it left half done is made anew.

Only the standard library is used, since this runs before anything is installed.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
STAMPS = VENV / ".stamps"
LOG = VENV / "setup.log"
BUILD = VENV / "build" / "pga_me_msgs"
REQUIREMENTS = ("run.txt", "build.txt", "test.txt")
RUNNING = "running"
LOG_LINES_SHOWN = 10
BOOTSTRAP_GUARD = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


class SetupError(Exception):
    """The set-up cannot go on; the message says why and what to do."""


@dataclass(frozen=True)
class Step:
    """One part of the set-up.

    Attributes:
        name: name of its stamp, and on the command line.
        announcement: what the user reads when it starts.
        inputs: gives the files and words that its result depends on.
        run: does it.
    """

    name: str
    announcement: str
    inputs: Callable[[], Iterable[Path | str]]
    run: Callable[[], None]

    def stamp(self) -> str:
        """Return the digest of the last completed run, RUNNING after one that was cut off, or ''."""
        path = STAMPS / self.name
        return path.read_text() if path.is_file() else ""

    def digest(self) -> str:
        """Return the digest of the step's inputs as they are now."""
        digest = hashlib.sha256()
        for item in self.inputs():
            if isinstance(item, Path):
                digest.update(item.relative_to(ROOT).as_posix().encode() + b"\0")
                digest.update(item.read_bytes())
            else:
                digest.update(item.encode())
            digest.update(b"\0")
        return digest.hexdigest()


def files_below(*names: str) -> Iterator[Path]:
    """Yield the files named, and those below the folders named, relative to the checkout, in a fixed order."""
    for name in names:
        path = ROOT / name
        if path.is_dir():
            yield from sorted(entry for entry in path.rglob("*") if entry.is_file())
        elif path.is_file():
            yield path


def clean_environment() -> dict[str, str]:
    """Return the environment for the tools: this venv first, nothing of another Python, workspace or make."""
    environment = dict(os.environ)
    # The wheels' bootstrap trusts LD_LIBRARY_PATH when its guard is set, and both may be another environment's.
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
    """Return the first lines that name an error (a parallel build buries them), or the last lines if none does."""
    errors = [line for line in output if re.search(r"\berror\b", line, re.IGNORECASE)]
    return errors[:LOG_LINES_SHOWN] or output[-LOG_LINES_SHOWN:]


def run_logged(*command: str | Path, cwd: Path = ROOT) -> None:
    """Run a command with its output in the log.

    Raises:
        SetupError: it failed; the message holds the end of its output.
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
            "\n".join([*telling_lines(output), f"error: set-up failed; the whole log is {LOG}"])
        )


def base_python() -> str:
    """Return the interpreter that venvs are made from, also when .venv's own python runs this script."""
    return getattr(sys, "_base_executable", sys.executable)


def create_venv() -> None:
    """Make .venv, or mend the one that is there."""
    run_logged(base_python(), "-m", "venv", VENV)


def install_requirements() -> None:
    """Install the pinned dependencies; one pip call, so that it finds any conflict among them."""
    pins = [word for name in REQUIREMENTS for word in ("-r", f"requirements/{name}")]
    run_logged(
        VENV / "bin/python",
        "-m",
        "pip",
        "install",
        "--no-input",
        "--disable-pip-version-check",
        *pins,
    )


def build_messages() -> None:
    """Build and install the message package from scratch, after removing what the last build installed."""
    manifest = BUILD / "install_manifest.txt"
    if manifest.is_file():
        for line in manifest.read_text().splitlines():
            Path(line).unlink(missing_ok=True)
    shutil.rmtree(BUILD, ignore_errors=True)
    cmake = VENV / "bin/cmake"
    run_logged(
        cmake, "-S", "msg_defs", "-B", BUILD, "-G", "Unix Makefiles",
        f"-DCMAKE_INSTALL_PREFIX={VENV}",
        f"-DPython3_EXECUTABLE={VENV / 'bin/python3'}",
        f"-DCMAKE_PROJECT_INCLUDE={ROOT / 'scripts/drop_missing_includes.cmake'}",
        "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF",
    )  # fmt: skip
    run_logged(cmake, "--build", BUILD, "--parallel", str(os.cpu_count() or 1))
    run_logged(cmake, "--install", BUILD)


def install_package() -> None:
    """Make the checkout importable, and put what ROS looks for (index, executables, config) into the prefix."""
    python = VENV / "bin/python"
    run_logged(
        python, "-m", "pip", "install", "--no-deps", "--no-build-isolation", "--editable", "."
    )
    # An editable install leaves the data files out.
    run_logged(python, "setup.py", "--quiet", "install_data", f"--install-dir={VENV}")
    shutil.copy(ROOT / "scripts/setup.bash", VENV / "setup.bash")


STEPS = (
    Step(
        "venv",
        "creating the Python environment .venv",
        lambda: [str(VENV)],  # an environment works only where it was made
        create_venv,
    ),
    Step(
        "requirements",
        "installing the pinned dependencies (minutes, the first time)",
        lambda: files_below("requirements"),
        install_requirements,
    ),
    Step(
        "messages",
        "building the message package pga_me_msgs (about a minute)",
        lambda: files_below(
            "msg_defs", "scripts/drop_missing_includes.cmake", "requirements/build.txt"
        ),
        build_messages,
    ),
    Step(
        "package",
        "installing pga_me_ros from this checkout",
        lambda: files_below(
            "setup.py", "setup.cfg", "package.xml", "resource", "config", "scripts/setup.bash"
        ),
        install_package,
    ),
)


def check_machine() -> None:
    """Check that what cannot be installed from here is there.

    Raises:
        SetupError: a tool or the Python headers are missing.
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
        raise SetupError(
            f"error: {base_python()} lacks its C headers (Python.h); install its development package"
        )
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        raise SetupError(
            f"error: {base_python()} lacks the venv module; install its venv package"
        ) from None


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Hold off a second set-up of this checkout until the first is done."""
    descriptor = os.open(ROOT / "requirements", os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("pga_me_ros: waiting for another set-up of this checkout", flush=True)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def is_unusable() -> bool:
    """Return whether .venv was cut off while packages went in, moved here from elsewhere, or lost its Python."""
    if not VENV.exists():
        return False
    environment, requirements = (step.stamp() for step in STEPS[:2])
    moved = environment not in ("", STEPS[0].digest())
    return moved or requirements == RUNNING or not (VENV / "bin/python").exists()


def outdated(names: Iterable[str]) -> list[Step]:
    """Return the steps to run, in order, of those named (all when none is)."""
    wanted = set(names) or {step.name for step in STEPS}
    return [step for step in STEPS if step.name in wanted and step.stamp() != step.digest()]


def perform(steps: Iterable[Step]) -> None:
    """Run the steps, keeping their stamps."""
    for step in steps:
        print(f"pga_me_ros: {step.announcement}", flush=True)
        stamp, digest = STAMPS / step.name, step.digest()
        STAMPS.mkdir(parents=True, exist_ok=True)
        stamp.write_text(RUNNING)
        try:
            step.run()
        except SetupError:
            # It failed in an orderly way: run it again next time, but nothing is left half done.
            stamp.unlink()
            raise
        stamp.write_text(digest)


def main(names: list[str]) -> int:
    """Run the named steps, or all, as far as they are out of date; return the exit status."""
    began = time.monotonic()
    unknown = set(names) - {step.name for step in STEPS}
    if unknown:
        print(
            f"error: no set-up step {', '.join(unknown)}; there are {', '.join(s.name for s in STEPS)}",
            file=sys.stderr,
        )
        return 2
    try:
        with one_at_a_time():
            unusable = is_unusable()
            if not unusable and not outdated(names):
                return 0
            check_machine()
            if unusable:
                print(
                    "pga_me_ros: .venv is half finished or was moved; starting it afresh",
                    flush=True,
                )
                shutil.rmtree(VENV)
            perform(outdated(names))
    except SetupError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nerror: set-up interrupted; the same command starts it again", file=sys.stderr)
        return 130
    print(f"pga_me_ros: set up in {time.monotonic() - began:.0f} s (log: {LOG})", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
