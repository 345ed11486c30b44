"""Params files: which nodes they are for, and errors for those that ROS 2 cannot read."""

from __future__ import annotations

from pathlib import Path

import pytest

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.params_file import matches, sections


def test_sections_are_found_in_nested_namespaces(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "/**: {ros__parameters: {a: 1}}\n"
        "one: {two: {orchestrator: {ros__parameters: {a: 1}}}}\n"
        "/three/evaluator: {ros__parameters: {a: 1}}\n"
    )
    assert sections(path) == ["/**", "/one/two/orchestrator", "/three/evaluator"]


@pytest.mark.parametrize(
    ("section", "node", "meant"),
    [
        ("/**", "/orchestrator", True),
        ("/**", "/a/b/orchestrator", True),
        ("/**/orchestrator", "/orchestrator", True),
        ("/**/orchestrator", "/a/b/orchestrator", True),
        ("/**/orchestrator", "/a/evaluator", False),
        ("/*/orchestrator", "/a/orchestrator", True),
        ("/*/orchestrator", "/a/b/orchestrator", False),
        ("/*", "/orchestrator", True),
        ("orchestrator", "/orchestrator", True),
        ("/orchestrator", "/a/orchestrator", False),
        ("/a.b", "/axb", False),
    ],
)
def test_a_section_is_meant_for_the_nodes_it_matches(section: str, node: str, meant: bool) -> None:
    assert matches(section, node) == meant


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1\n", "not valid YAML at line 2, column 1"),
        ("a: 1\na: 2\n", "not valid YAML at line 2, column 1: 'a' is given twice"),
        ("/**:\n  ros__parameters:\n\ta: 1\n", "not valid YAML at line 3, column 1"),
        ("", "names no node; expected a section"),
        ("- 1\n", "names no node"),
        ("evaluations: 5\n", "a value for '/evaluations' outside 'ros__parameters'"),
        ("/**:\n  evaluations: 5\n", r"a value for '/\*\*/evaluations' outside"),
        ("/**:\n  ros__parameters:\n", r"no parameters below '/\*\*'; expected"),
        ("/**:\n  ros__parameters: 5\n", r"no parameters below '/\*\*'"),
    ],
)
def test_a_file_of_another_layout_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=words):
        sections(path)


def test_a_file_of_bytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(SettingsError, match="not valid YAML"):
        sections(path)


def test_a_missing_file_is_refused_with_a_suggestion(tmp_path: Path) -> None:
    (tmp_path / "qd_walker.yaml").touch()
    with pytest.raises(
        SettingsError, match=r"no params file .*\(did you mean 'qd_walker.yaml'\?\)"
    ):
        sections(tmp_path / "qd_wlker.yaml")


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"cannot be read \(Is a directory"):
        sections(tmp_path)
