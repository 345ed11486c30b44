"""The rules of the source: which way dependencies point, how long files are, and that docs name only what exists."""

from __future__ import annotations

import ast
import importlib
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "pga_me_ros"
LONGEST = 330
"""Maximum lines of a source file; the aim is about 300."""

ROOTS = {"errors", "arrays", "arguments", "dependencies", "paths", "yaml_files"}
"""Files at the top of the package that every package may import; they import none."""

FACE = {"library"}
"""The module for Python users; it may import everything, and no package imports it."""

MAY_IMPORT = {
    "tasks": set(),
    "tasks/bullet": {"tasks"},
    "process": set(),
    "core/settings": set(),
    "core/networks": {"core/settings"},
    "core/archive": {"core", "core/networks", "core/settings", "tasks"},
    "core/gradients": {"core/networks"},
    "core/learning": {"core", "core/gradients", "core/networks", "core/settings", "tasks"},
    "core/variation": {"core", "core/gradients", "core/networks", "core/settings"},
    "core/algorithms": {
        "core",
        "core/archive",
        "core/learning",
        "core/networks",
        "core/settings",
        "core/variation",
        "tasks",
    },
    "core": {
        "core/algorithms",
        "core/archive",
        "core/networks",
        "core/settings",
        "core/variation",
        "tasks",
    },
    "core/adaptation": {"core/archive", "core/settings"},
    "core/storage": {"core", "core/archive", "core/networks", "core/settings", "tasks"},
    "core/runs": {
        "core",
        "core/algorithms",
        "core/archive",
        "core/networks",
        "core/settings",
        "core/storage",
        "core/variation",
        "tasks",
    },
    "core/training": {
        "core",
        "core/algorithms",
        "core/learning",
        "core/runs",
        "core/settings",
        "tasks",
    },
    "ros": {"core*", "process", "tasks"},
    "client": {"core/networks", "core/storage", "process", "ros"},
    "adapting": {"client", "core*", "ros"},
    "hardware": {"client", "core*", "player", "ros"},
    "orchestration": {"core*", "process", "ros", "tasks"},
    "serving": {"core*", "ros", "tasks"},
    "nodes": {
        "adapting",
        "client",
        "core*",
        "hardware",
        "orchestration",
        "player",
        "process",
        "recording",
        "ros",
        "serving",
        "tasks",
    },
    "adapt_demo": {"client", "core*", "process", "ros", "tasks"},
    "demo": {"client", "core*", "process", "ros", "tasks"},
    "player": {"client", "core*", "tasks"},
    "render": {"core*", "player", "process", "tasks"},
    "explorer": {"client", "core*", "export", "player", "process", "query", "ros", "tasks"},
    "report": {"core*", "experiment", "process", "tasks"},
    "export": {"core*", "process", "tasks"},
    "thin": {"core*", "process"},
    "reevaluate": {"core*", "process", "tasks"},
    "query": {"client", "core*", "export", "process", "ros"},
    "recording": {"core*", "ros", "tasks"},
    "replay": {"core*", "process", "recording", "ros", "tasks"},
    "experiment": {"core*", "process", "reevaluate", "ros", "tasks"},
}
"""What each package may import besides itself; ``core*`` means every package of core. docs/design.md says why."""

ROS_PACKAGES = {
    "adapt_demo",
    "adapting",
    "ros",
    "client",
    "hardware",
    "orchestration",
    "serving",
    "nodes",
    "demo",
    "explorer",
    "player",
    "query",
    "recording",
    "replay",
}
TORCH = {
    "core/gradients",
    "core/learning",
    "core/training",
    "core/variation/policy_gradient",
    "core/algorithms/dcrl/textbook_step",
    "core/algorithms/qd_rl/learner",
    "core/algorithms/qd_rl/diversity_replay",
    "core/algorithms/td3/learner",
    "core/algorithms/learners",
    "export",
    "replay",
}
"""Packages and files that may import torch directly; everything else stays light."""

PYBULLET = {"tasks/bullet", "tasks/body", "player", "render", "reevaluate"}

ONLY_DATA_OF_TASKS = {"protocol", "rollout", "spec"}
"""What core may know about tasks: what a task and an episode are, but not which tasks exist."""

IN_CORE = {
    "search",
    "plan",
    "evaluation",
    "exploration",
    "batch",
    "snapshot",
    "operators",
    "rng",
    "__init__",
}
"""The files of core outside its packages: the algorithm itself."""

NODES = {
    "adapter",
    "archive_manager",
    "behavior_player",
    "controller",
    "critic_trainer",
    "evaluator",
    "orchestrator",
    "record",
    "variation",
}

SOURCES = sorted((ROOT / PACKAGE).rglob("*.py"))


def name(path: Path) -> str:
    return str(path.relative_to(ROOT / PACKAGE))


def module(path: Path) -> str:
    return name(path).removesuffix(".py").removesuffix("/__init__").replace("/", ".")


MODULES = {module(path): path for path in SOURCES if name(path) != "__init__.py"}


def imported(path: Path) -> set[str]:
    """Return every module and name that a file imports, from anywhere in it: in functions and for types, too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def imports(path: Path) -> set[str]:
    """Return the modules of the package that a file imports, without the package's name."""
    prefix = f"{PACKAGE}."
    own = {name.removeprefix(prefix) for name in imported(path) if name.startswith(prefix)}
    return {n if n in MODULES else n.rpartition(".")[0] for n in own} - {module(path), ""}


def package_of(where: str) -> str:
    """Return the package of a module: its folder, as deep as `MAY_IMPORT` goes."""
    parts = name(MODULES[where]).split("/")[:-1]
    return next((r for n in (2, 1) if (r := "/".join(parts[:n])) in MAY_IMPORT), "/".join(parts))


def is_within(where: str, allowed: set[str]) -> bool:
    path = where.replace(".", "/")
    return any(path == a or path.startswith(f"{a}/") for a in allowed)


@pytest.mark.parametrize("own", list(MAY_IMPORT))
def test_dependencies_point_one_way(own):
    allowed = MAY_IMPORT[own] | {own}
    if "core*" in allowed:
        allowed |= {r for r in MAY_IMPORT if r.split("/")[0] == "core"}
    wrong = {
        (m, other)
        for m, path in MODULES.items()
        if m not in ROOTS | FACE and package_of(m) == own
        for other in imports(path) - ROOTS
        if package_of(other) not in allowed
    }
    assert wrong == set()


def test_every_folder_of_the_package_has_its_rule():
    assert {package_of(m) for m in MODULES if "/" in name(MODULES[m])} == set(MAY_IMPORT)
    assert {m for m in MODULES if "/" not in name(MODULES[m])} == ROOTS | FACE


def test_the_files_at_the_top_import_no_package():
    assert all(imports(MODULES[m]) <= ROOTS for m in ROOTS)


def test_there_is_no_import_circle():
    graph = {m: imports(path) for m, path in MODULES.items()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_core_imports_no_particular_task():
    wrong = {
        (m, other)
        for m, path in MODULES.items()
        if m.startswith("core.")
        for other in imports(path)
        if other.startswith("tasks.") and other.split(".")[1] not in ONLY_DATA_OF_TASKS
    }
    assert wrong == set()


def test_core_has_only_the_files_of_the_algorithm_outside_its_packages():
    assert {path.stem for path in (ROOT / PACKAGE / "core").glob("*.py")} == IN_CORE


def test_nodes_contains_only_the_nodes():
    assert {path.stem for path in (ROOT / PACKAGE / "nodes").glob("*.py")} == {*NODES, "__init__"}


@pytest.mark.parametrize(
    ("packages", "allowed"),
    [
        (("rclpy", "pga_me_msgs", "std_msgs", "sensor_msgs"), ROS_PACKAGES),
        (("torch",), TORCH),
        (("pybullet",), PYBULLET),
    ],
)
def test_heavy_packages_are_imported_where_they_belong(packages, allowed):
    wrong = {
        m
        for m, path in MODULES.items()
        if any(i.split(".")[0] in packages for i in imported(path)) and not is_within(m, allowed)
    }
    assert wrong == set()


def test_no_two_names_differ_by_case_only():
    names: dict[str, set[str]] = {}
    for path in SOURCES:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.setdefault(node.name.lower(), set()).add(node.name)
    assert [sorted(same) for same in names.values() if len(same) > 1] == []


def test_files_stay_short_enough_to_read():
    lengths = {name(path): len(path.read_text().splitlines()) for path in SOURCES}
    assert {n: length for n, length in lengths.items() if length > LONGEST} == {}


def test_no_file_has_a_catch_all_name():
    drawers = {"utils", "util", "helpers", "helper", "common", "misc"}
    files = [*SOURCES, *(ROOT / "test").rglob("*.py")]
    assert [path for path in files if path.stem in drawers] == []


def documented_names() -> list[str]:
    """Return the code named in the tables of docs/algorithm.md, as ``package.module:attribute``."""
    document = (ROOT / "docs" / "algorithm.md").read_text()
    tables = document.partition("## From line to function")[2].partition("## Words")[0]
    found = []
    for row in re.findall(r"^\| \d.*\|$", tables, re.MULTILINE):
        for code in re.findall(r"`([^`]+)`", row.rsplit("|", 2)[1]):
            *folders, last = code.split("/")
            where, _, attribute = last.partition(".")
            found.append(f"{PACKAGE}.{'.'.join([*folders, where])}:{attribute}")
    return found


@pytest.mark.parametrize("where", sorted(set(documented_names())))
def test_documented_functions_exist(where):
    module, _, attributes = where.partition(":")
    found = importlib.import_module(module)
    for attribute in attributes.split("."):
        found = getattr(found, attribute)
    assert callable(found)


@pytest.mark.parametrize("document", ["algorithm.md", "algorithms.md", "tasks.md"])
def test_links_of_the_docs_have_targets(document):
    targets = re.findall(r"\]\(([^)#]+)\)", (ROOT / "docs" / document).read_text())
    assert targets
    missing = [t for t in targets if "://" not in t and not (ROOT / "docs" / t).exists()]
    assert missing == []
