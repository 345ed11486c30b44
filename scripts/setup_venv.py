"""Bring .venv up to date: environment, pinned dependencies, message package, this package.

Each step leaves a stamp in .venv/.stamps with a digest of what it depends on, and runs again only
when that changes. While a step runs, its stamp says so; a step that was interrupted is therefore
detected and repeated.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from setup_steps import (
    LOG,
    ROOT,
    VENV,
    SetupError,
    build_messages,
    build_tf2_msgs,
    check_machine,
    create_venv,
    install_package,
    install_requirements,
    is_of_another_python,
)

STAMPS = VENV / ".stamps"
RUNNING = "running"


@dataclass(frozen=True)
class Step:
    """One part of the setup.

    Attributes:
        name: Name of its stamp, and on the command line.
        announcement: Message for the user when it starts.
        inputs: Returns the files and words that its result depends on.
        run: Carries out the step.
    """

    name: str
    announcement: str
    inputs: Callable[[], Iterable[Path | str]]
    run: Callable[[], None]

    def stamp(self) -> str:
        """Return the digest of the last complete run, RUNNING if it was interrupted, or ''."""
        path = STAMPS / self.name
        return path.read_text() if path.is_file() else ""

    def digest(self) -> str:
        """Return the digest of the step's present inputs."""
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
    """Yield the given files and those below the given folders, in a fixed order."""
    for name in names:
        path = ROOT / name
        if path.is_dir():
            yield from sorted(entry for entry in path.rglob("*") if entry.is_file())
        elif path.is_file():
            yield path


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
            "msg_defs", "scripts/interface_packages.cmake", "requirements/build.txt"
        ),
        build_messages,
    ),
    Step(
        "transforms",
        "building tf2_msgs, for which there is no wheel",
        lambda: files_below(
            "scripts/tf2_msgs", "scripts/interface_packages.cmake", "requirements/build.txt"
        ),
        build_tf2_msgs,
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


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Make a second setup of this checkout wait until the first is done."""
    descriptor = os.open(ROOT / "requirements", os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("pga_me_ros: waiting for another setup of this checkout", flush=True)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def is_unusable() -> bool:
    """Return whether an installation into .venv was interrupted, or .venv was moved, or has another Python."""
    if not VENV.exists():
        return False
    environment, requirements = (step.stamp() for step in STEPS[:2])
    moved = environment not in ("", STEPS[0].digest())
    gone = not (VENV / "bin/python").exists()
    return moved or requirements == RUNNING or gone or is_of_another_python()


def outdated(names: Iterable[str]) -> list[Step]:
    """Return the steps to run, in order, among the given ones (all by default)."""
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
            # It failed but was not interrupted: run it again next time, without starting over.
            stamp.unlink()
            raise
        stamp.write_text(digest)


def main(names: list[str]) -> int:
    """Run the given steps, or all, if they are out of date; return the exit status."""
    began = time.monotonic()
    known = [step.name for step in STEPS]
    for name in set(names) - set(known):
        print(f"error: no setup step {name}; the steps are {', '.join(known)}", file=sys.stderr)
        return 2
    try:
        with one_at_a_time():
            unusable = is_unusable()
            if not unusable and not outdated(names):
                return 0
            check_machine()
            if unusable:
                print(
                    "pga_me_ros: .venv is incomplete, was moved, or has another Python; creating it again",
                    flush=True,
                )
                shutil.rmtree(VENV)
            perform(outdated(names))
    except SetupError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nerror: setup interrupted; the same command starts it again", file=sys.stderr)
        return 130
    print(f"pga_me_ros: setup took {time.monotonic() - began:.0f} s (log: {LOG})", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
