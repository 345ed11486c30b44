"""Both packages are described as ROS tools expect: a valid manifest, a changelog and a license."""

from __future__ import annotations

from pathlib import Path

import pytest
from catkin_pkg.package import parse_package

ROOT = Path(__file__).resolve().parents[2]

FOLDERS = pytest.mark.parametrize(
    "folder", [ROOT, ROOT / "msg_defs"], ids=["pga_me_ros", "pga_me_msgs"]
)


@FOLDERS
def test_the_manifest_is_valid_and_says_where_to_read_more(folder: Path) -> None:
    warnings: list[str] = []
    package = parse_package(str(folder / "package.xml"), warnings=warnings)
    assert warnings == []
    assert [(url.type, url.url) for url in package.urls] == [
        ("website", "https://doi.org/10.1145/3449639.3459304")
    ]


@FOLDERS
def test_changelog_and_license_are_there(folder: Path) -> None:
    name = parse_package(str(folder / "package.xml")).name
    head = (folder / "CHANGELOG.rst").read_text().splitlines()
    assert head[1] == f"Changelog for package {name}"
    assert "Forthcoming" in head
    assert (folder / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
