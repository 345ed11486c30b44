"""Links of the docs to code: the file has the name that the page gives it, and defines what the page names."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
LINK = re.compile(r"\[`?([\w./]+\.py|[\w.]+)`?\]\((\.\./[\w/]+\.py)\)")
LINKS = sorted(
    {
        (page.name, label, target)
        for page in DOCS.glob("*.md")
        for label, target in LINK.findall(page.read_text())
    }
)


def defined(file: Path) -> set[str]:
    """Return functions and classes of a file, methods as ``Class.method``."""
    found = set()
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            methods = (part for part in node.body if isinstance(part, ast.FunctionDef))
            found |= {f"{node.name}.{method.name}" for method in methods}
    return found


def test_some_links_name_code() -> None:
    assert sum(not label.endswith(".py") for _, label, _ in LINKS) > 5


@pytest.mark.parametrize(("page", "label", "target"), LINKS)
def test_a_link_has_the_name_of_its_code(page: str, label: str, target: str) -> None:
    file = (DOCS / target).resolve()
    if label.endswith(".py"):
        assert file.as_posix().endswith(f"/{label}"), page
        return
    module, _, name = label.partition(".")
    if name:
        assert module == file.stem, page
    assert (name or module) in defined(file), page
