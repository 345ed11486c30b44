"""The recipes of CONTRIBUTING.md: each works, and needs only the files that it names."""

from __future__ import annotations

from pathlib import Path

import pytest
from changed_copy import ROOT, ChangedCopy, files_of_recipe


@pytest.fixture
def copy(tmp_path: Path) -> ChangedCopy:
    return ChangedCopy(tmp_path)


def named(copy: ChangedCopy, name: str) -> set[str]:
    """Return the changed files as a recipe names them."""
    return {path.replace(name, "NAME") for path in copy.touched}


SEARCH = """
import sys
from pga_me_ros.core.operators import Operator
from pga_me_ros import Search, Settings, make_task
settings = Settings.from_mapping({"task": "qd_hopper", "evaluations": 40, "random_init": 10, "batch_size": 10,
    "controller_hidden": (4,), "cells": 20, "cvt_samples": 500, **eval(sys.argv[1])})
task = make_task("qd_hopper")
search = Search(task.spec, settings)
for _ in range(settings.generations):
    metrics = search.run_generation(task)
print(metrics.offspring, type(search.archive).__name__)
"""


def add_operator(copy: ChangedCopy) -> None:
    copy.insert(
        "pga_me_ros/core/operators.py", "    LEAP = 99\n", after="    ACTOR_INJECTION = 9\n"
    )
    copy.insert(
        "pga_me_ros/core/operators.py",
        '    Operator.LEAP: OperatorRow("leap", parents=1),\n',
        before="    Operator.DIVERSITY: OperatorRow(",
    )
    copy.insert(
        "pga_me_ros/core/variation/make_offspring.py",
        "    Operator.LEAP: lambda w: w.parents[:, 0] * np.float32(0.5),\n",
        before="    Operator.GA: _ga,\n",
    )
    copy.insert(
        "pga_me_ros/core/variation/make_offspring.py",
        "import numpy as np\n",
        before="from pga_me_ros.arrays import Float32Array\n",
    )


def test_a_new_operator(copy: ChangedCopy) -> None:
    add_operator(copy)
    assert named(copy, "leap") == files_of_recipe("An operator")
    program = (
        "from pga_me_ros.core.operators import OPERATORS, Operator\n"
        "from pga_me_ros.core.variation.make_offspring import MAKERS\n"
        "print(Operator.LEAP.label, OPERATORS[Operator.LEAP].parents, Operator.LEAP in MAKERS)"
    )
    assert copy.run(program) == "leap 1 True\n"


def test_a_new_algorithm(copy: ChangedCopy) -> None:
    add_operator(copy)  # the operator of its offspring
    operators = set(copy.touched)
    core = "pga_me_ros/core"
    copy.write(
        f"{core}/algorithms/leaping.py",
        '"""Halves its parents."""\n'
        "from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots\n"
        "from pga_me_ros.core.operators import Operator\n\n\n"
        "class Leaping(Algorithm):\n"
        '    name, title, operators = "leaping", "Leaping", (Operator.LEAP,)\n\n'
        "    def offspring(self, settings, generation):\n"
        "        return [Slots(Operator.LEAP, 0, settings.batch_size)]\n",
    )
    registry = f"{core}/algorithms/__init__.py"
    copy.insert(
        registry,
        "from pga_me_ros.core.algorithms.leaping import Leaping\n",
        before="from pga_me_ros.core.algorithms.map_elites import",
    )
    copy.insert(registry, ", Leaping()", after="QdRl()")
    copy.insert(
        f"{core}/settings/run.py", '"leaping", ', before='"pga_map_elites",\n    "map_elites",'
    )
    copy.insert(
        f"{core}/settings/algorithms.py",
        '    leap: float = setting(0.5, "leaping: share.", low=0.0, high=1.0, part="leaping")\n',
        before="    exploration_sigma: float",
    )
    copy.insert(
        f"{core}/settings/rules.py",
        'class _Leaping(Rules):\n    parts = ("leaping",)\n\n\n',
        before="RULES: Mapping",
    )
    copy.insert(
        f"{core}/settings/rules.py",
        '    "leaping": _Leaping(),\n',
        before='    "pga_map_elites": _PgaMapElites(),\n',
    )
    assert named(copy, "leaping") - operators == files_of_recipe("An algorithm")
    printed = copy.run(SEARCH, "{'algorithm': 'leaping', 'leap': 0.25}")
    assert printed == "(0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 10) CvtArchive\n"


def test_a_new_kind_of_archive(copy: ChangedCopy) -> None:
    archive = "pga_me_ros/core/archive"
    copy.write(
        f"{archive}/halves.py",
        '"""Two cells: below and above the middle of the first descriptor."""\n'
        "import numpy as np\n"
        "from pga_me_ros.core.archive.archive import Archive\n\n\n"
        "class HalvesArchive(Archive):\n"
        '    kind = "halves"\n\n'
        "    def _nearest_cells(self, descriptors):\n"
        "        middle = (self.low[0] + self.high[0]) / 2\n"
        "        return (descriptors[:, 0] > middle).astype(np.int64)\n",
    )
    copy.insert(
        f"{archive}/make_archive.py",
        "from pga_me_ros.core.archive.halves import HalvesArchive\n",
        after="from pga_me_ros.core.archive.grid import GridArchive\n",
    )
    copy.insert(
        f"{archive}/make_archive.py",
        "    HalvesArchive.kind: ArchiveKind(\n"
        "        lambda spec, settings: 2,\n"
        "        lambda spec, settings, n: HalvesArchive(\n"
        "            [[0.25], [0.75]], spec.descriptor_low, spec.descriptor_high, n\n"
        "        ),\n"
        "        lambda geometry, centroids, version: HalvesArchive(\n"
        "            centroids, geometry['low'], geometry['high'], geometry['parameter_count']\n"
        "        ),\n"
        "    ),\n",
        before="    GridArchive.kind: ArchiveKind(\n",
    )
    copy.insert("pga_me_ros/core/settings/run.py", '"halves", ', before='"cvt", "grid")')
    assert named(copy, "halves") == files_of_recipe("A kind of archive")
    given = "{'algorithm': 'map_elites', 'archive': 'halves', 'cells': 0, 'cvt_samples': 100_000}"
    program = (
        "import sys\n"
        f"sys.argv = ['', {given!r}]\n{SEARCH}\n"
        "from pga_me_ros import StoredRun, save_run\n"
        "print(type(StoredRun.load(save_run('stored', search).file).archive).__name__)"
    )
    grown, stored = copy.run(program).splitlines()
    assert (grown.split()[-1], stored) == ("HalvesArchive", "HalvesArchive")


def test_a_new_setting(copy: ChangedCopy) -> None:
    copy.insert(
        "pga_me_ros/core/settings/learning.py",
        '    patience: int = setting(3, "Tries.", low=1, high=9, rate=True, part="critics")\n',
        before="    iso_sigma: float",
    )
    assert copy.touched < files_of_recipe("A setting")
    program = (
        "from pga_me_ros.core.settings import RATES, Settings\n"
        "print(Settings(patience=4).patience, 'patience' in RATES)\n"
        "try: Settings(algorithm='map_elites', patience=4)\n"
        "except ValueError as error: print(error)"
    )
    assert copy.run(program) == (
        "4 True\npatience is 4, but map_elites doesn't use it; remove patience.\n"
    )


def test_a_new_export_format(copy: ChangedCopy, hopper_run: Path) -> None:
    copy.write(
        "pga_me_ros/export/cells.py",
        '"""The numbers of the cells, one a line."""\n'
        "from pga_me_ros.core.storage.files import save_bytes\n\n\n"
        "def write_cells(source, path):\n"
        '    save_bytes(path, "".join(f"{e.cell}\\n" for e in source.elites()).encode())\n',
    )
    main = "pga_me_ros/export/__main__.py"
    copy.insert(
        main,
        "from pga_me_ros.export.cells import write_cells\n",
        before="from pga_me_ros.export.source import Source\n",
    )
    copy.insert(main, '"cells": (write_cells, ".txt"), ', before='"npz": (write_npz, ".npz"),')
    assert named(copy, "cells") == files_of_recipe("An export format")
    program = "import sys; from pga_me_ros.export.__main__ import main; sys.exit(main())"
    printed = copy.run(program, str(hopper_run), "--to", "cells", "--out", "out.txt")
    assert printed == "out.txt\n"
    cells = [int(line) for line in (copy.folder / "out.txt").read_text().split()]
    assert cells
    assert cells == sorted(set(cells))


def test_a_new_node(copy: ChangedCopy) -> None:
    copy.write(
        "pga_me_ros/nodes/greeter.py",
        '"""Says hello."""\n'
        "from rclpy.node import Node\n\n\n"
        "def main():\n    print(Node.__name__, 'hello')\n    return 0\n\n\n"
        'if __name__ == "__main__":\n    raise SystemExit(main())\n',
    )
    link = copy.folder / "resource" / "executables" / "greeter"
    link.parent.mkdir(parents=True)
    starter = link.parent.parent / "start_node"
    starter.write_text((ROOT / "resource" / "start_node").read_text())
    starter.chmod(0o755)
    link.symlink_to("../start_node")
    copy.touched.add("resource/executables/greeter")
    assert named(copy, "greeter") < files_of_recipe("A node")
    program = f"import subprocess; print(subprocess.check_output([{str(link)!r}], text=True))"
    assert "hello" in copy.run(program)


def test_a_new_task_needs_no_file_of_the_package(tmp_path: Path) -> None:
    assert not any(name.startswith("pga_me_ros/") for name in files_of_recipe("A task"))
    copy = ChangedCopy(tmp_path)
    for file in (ROOT / "examples" / "my_robot").iterdir():
        if file.is_file():
            copy.write(file.name, file.read_text())
    program = (
        "from pga_me_ros import load_task; print(load_task('my_task:Crawler').spec.name)\n"
        "from pga_me_ros.tasks.check import check_task\n"
        "print(check_task(load_task('my_task:Crawler')))"
    )
    assert copy.run(program).splitlines()[-1] == "[]"
