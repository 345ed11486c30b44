"""Workarounds for rclpy: the table in docs/design.md names their places, for the installed version."""

from __future__ import annotations

import importlib
import re
from importlib.metadata import version
from pathlib import Path

import pytest

DESIGN = Path(__file__).resolve().parents[2] / "docs" / "design.md"
SECTION = DESIGN.read_text().partition("## Workarounds for rclpy")[2]
PLACES = re.findall(r"\| `(pga_me_ros\.[\w.]+)` \|$", SECTION, re.MULTILINE)


def test_they_are_for_the_installed_version() -> None:
    advice = "look at each workaround again, then put the new version into docs/design.md"
    assert re.findall(r"in version ([\d.]+\d)", SECTION) == [version("rclpy")], advice


def test_every_row_names_a_place() -> None:
    rows = [line for line in SECTION.splitlines() if line.startswith("| ")]
    assert len(PLACES) == len(rows) - 1 > 0


@pytest.mark.parametrize("place", PLACES)
def test_each_place_in_the_table_exists(place: str) -> None:
    parts = place.split(".")
    found = importlib.import_module(".".join(parts[:3]))
    for attribute in parts[3:]:
        found = getattr(found, attribute)
