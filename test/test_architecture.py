"""The house rules: which way dependencies point, how long files are, and that the docs name what is there."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "pga_me_ros"
LONGEST = 330
"""Lines of the longest source file; about 300 is the aim."""

MAY_IMPORT = {
    "core": {"core", "tasks"},
    "tasks": {"core", "tasks"},
    "ros": {"core", "tasks", "ros"},
    "report": {"core", "tasks", "report"},
    "export": {"core", "tasks", "export"},
    "reevaluate": {"core", "tasks", "reevaluate"},
    "player": {"core", "tasks", "player", "client"},
    "render": {"core", "tasks", "player", "render"},
    "recording": {"core", "tasks", "ros", "recording"},
    "replay": {"core", "tasks", "ros", "recording", "replay"},
    "nodes": {"core", "tasks", "ros", "nodes", "client", "player", "recording"},
}
ONLY_DATA_OF_TASKS = {"protocol", "rollout", "spec"}
"""What core may know of tasks: what a task is and what an episode is, not which there are."""

SOURCES = sorted((ROOT / PACKAGE).rglob("*.py"))


def imports(path: Path) -> set[str]:
    """Return the modules of the package that a file imports, from anywhere in it, without the package's name."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    prefix = f"{PACKAGE}."
    return {name.removeprefix(prefix) for name in found if name.startswith(prefix)}


def name(path: Path) -> str:
    return str(path.relative_to(ROOT / PACKAGE))


@pytest.mark.parametrize("folder", list(MAY_IMPORT))
def test_dependencies_point_one_way(folder):
    wrong = {
        (name(path), module)
        for path in (ROOT / PACKAGE / folder).rglob("*.py")
        for module in imports(path)
        if module.partition(".")[0] not in MAY_IMPORT[folder]
    }
    assert wrong == set()


def test_core_knows_what_a_task_is_but_no_task():
    wrong = {
        (name(path), module)
        for path in (ROOT / PACKAGE / "core").rglob("*.py")
        for module in imports(path)
        if module.startswith("tasks.") and module.split(".")[1] not in ONLY_DATA_OF_TASKS
    }
    assert wrong == set()


def test_every_folder_of_the_package_has_its_rule():
    folders = {
        parts[0] for path in SOURCES if (parts := path.relative_to(ROOT / PACKAGE).parts)[1:]
    }
    assert folders == set(MAY_IMPORT)


def test_files_stay_short_enough_to_read():
    lengths = {name(path): len(path.read_text().splitlines()) for path in SOURCES}
    assert {n: length for n, length in lengths.items() if length > LONGEST} == {}


def test_no_file_is_a_drawer_for_anything():
    drawers = {"utils", "util", "helpers", "helper", "common", "misc"}
    files = [*SOURCES, *(ROOT / "test").rglob("*.py")]
    assert [path for path in files if path.stem in drawers] == []


def documented_names() -> list[str]:
    """Return what the tables of docs/algorithm.md say that is where, as ``package.module:attribute``."""
    document = (ROOT / "docs" / "algorithm.md").read_text()
    tables = document.partition("## From line to function")[2].partition("## Words")[0]
    found = []
    for row in re.findall(r"^\| \d.*\|$", tables, re.MULTILINE):
        for code in re.findall(r"`([^`]+)`", row.rsplit("|", 2)[1]):
            where = code if "." in code else f"critic.CriticTrainer.{code}"
            module, _, attribute = where.partition(".")
            folder = "" if "/" in module else "core."
            found.append(f"{PACKAGE}.{folder}{module.replace('/', '.')}:{attribute}")
    return found


@pytest.mark.parametrize("where", sorted(set(documented_names())))
def test_documented_functions_are_there(where):
    module, _, attributes = where.partition(":")
    found = importlib.import_module(module)
    for attribute in attributes.split("."):
        found = getattr(found, attribute)
    assert callable(found)


@pytest.mark.parametrize("document", ["algorithm.md", "algorithms.md", "tasks.md"])
def test_links_of_the_docs_lead_somewhere(document):
    targets = re.findall(r"\]\(([^)#]+)\)", (ROOT / "docs" / document).read_text())
    assert targets
    missing = [t for t in targets if "://" not in t and not (ROOT / "docs" / t).exists()]
    assert missing == []
