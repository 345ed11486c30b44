"""The pins in requirements/ are exact, consistent, and cover all dependencies."""

from __future__ import annotations

import re
from importlib.metadata import distributions
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parents[2] / "requirements"
PIN = re.compile(r"(?P<name>[A-Za-z0-9._-]+)(\[[a-z,]+\])?==(?P<version>[0-9][A-Za-z0-9.]*)")

# Part of the environment or the checkout, or pinned by torch's own wheel (CUDA builds).
NOT_PINNED = re.compile(r"pip|pga-me-(ros|msgs)|nvidia-.*|cuda-.*|triton")


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def pin_lines() -> list[str]:
    """Return the lines of all requirement files without comments."""
    lines = [
        line.partition("#")[0].strip()
        for path in sorted(REQUIREMENTS.glob("*.txt"))
        for line in path.read_text().splitlines()
    ]
    return [line for line in lines if line]


def pins() -> dict[str, str]:
    matches = [PIN.fullmatch(line) for line in pin_lines()]
    return {canonical(match["name"]): match["version"] for match in matches if match}


def test_every_pin_is_exact() -> None:
    assert [line for line in pin_lines() if not PIN.fullmatch(line)] == []


def test_nothing_is_pinned_twice() -> None:
    assert len(pins()) == len(pin_lines())


def test_everything_installed_is_pinned() -> None:
    # The ROS wheels contain .egg-info folders of their parts; packages that pip installed have a .dist-info.
    installed = {
        canonical(found.metadata["Name"]): found.version.partition("+")[0]
        for found in distributions()
        if found.read_text("WHEEL") is not None
    }
    unpinned = {name for name in installed if not NOT_PINNED.fullmatch(name)}
    assert {name: installed[name] for name in unpinned} == {
        name: version for name, version in pins().items() if name in installed
    }
