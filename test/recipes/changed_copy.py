"""A copy of the package in a temporary folder, changed according to a recipe of CONTRIBUTING.md."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class ChangedCopy:
    """The copy.

    Args:
        folder: Its folder.

    Attributes:
        touched: Files that were written or changed, relative to the root of the project.
    """

    folder: Path
    touched: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Copy the package with its bytecode, which still fits the files that are not changed."""
        shutil.copytree(ROOT / "pga_me_ros", self.folder / "pga_me_ros")

    def write(self, name: str, text: str) -> None:
        """Write a new file."""
        path = self.folder / name
        assert not path.exists()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        self.touched.add(name)

    def insert(self, name: str, text: str, *, before: str = "", after: str = "") -> None:
        """Insert text into a file, before or after a piece that occurs exactly once."""
        path = self.folder / name
        content, place = path.read_text(), before or after
        assert content.count(place) == 1, f"{name}: {place!r}"
        path.write_text(content.replace(place, f"{text}{place}" if before else f"{place}{text}"))
        self.touched.add(name)

    def run(self, program: str, *arguments: str) -> str:
        """Run a Python program with the copy instead of the package, and return its output."""
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            env={**os.environ, "PYTHONPATH": str(self.folder)},
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


def files_of_recipe(title: str) -> set[str]:
    """Return the files in the list of a recipe of CONTRIBUTING.md, with NAME instead of the new name."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    section = text.partition(f"### {title}\n")[2].partition("\n### ")[0].partition("\n## ")[0]
    assert section, title
    return set(re.findall(r"^- `([^`]+)`", section, re.MULTILINE))
