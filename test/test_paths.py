"""Paths and file names as users write them, wherever one is taken."""

from __future__ import annotations

import argparse
import importlib
import os
import re
import shutil
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from pga_me_ros import Search, Settings, StoredRun, make_task, save_run
from pga_me_ros.core.settings.field import checked_value
from pga_me_ros.core.storage.shipped import VARIABLE, shipped
from pga_me_ros.demo.arguments import find_config
from pga_me_ros.errors import SettingsError
from pga_me_ros.paths import file_name, listed_paths, user_path
from pga_me_ros.ros.command_line import Program, start

PACKAGE = Path(__file__).resolve().parents[1] / "pga_me_ros"
NODES = sorted(path.stem for path in (PACKAGE / "nodes").glob("[a-z]*.py"))
PROGRAMS = sorted(
    path.parent.name
    for path in PACKAGE.glob("*/__main__.py")
    if "def _parser()" in path.read_text()
)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a home folder, while the working directory is another one."""
    home = tmp_path / "home"
    for folder in (home, tmp_path / "elsewhere"):
        folder.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(tmp_path / "elsewhere")
    return home


@pytest.mark.parametrize("node", NODES)
def test_every_path_parameter_of_a_node_may_begin_with_a_tilde(node: str, home: Path) -> None:
    program: Program = importlib.import_module(f"pga_me_ros.nodes.{node}").PROGRAM
    for f in (f for kind in program.parameters for f in fields(kind) if f.metadata["path"]):
        assert checked_value(f, "~/runs/x") == f"{home}/runs/x", f.name


def test_every_parameter_that_names_a_path_says_so() -> None:
    found = {
        f.name
        for node in NODES
        for kind in importlib.import_module(f"pga_me_ros.nodes.{node}").PROGRAM.parameters
        for f in fields(kind)
        if re.search(r"folder|\bfile\b|directory", f.metadata["description"], re.IGNORECASE)
        and isinstance(f.default, str)
    }
    assert found >= {"run_dir", "start_from", "repertoire", "bag"}
    for node in NODES:
        for kind in importlib.import_module(f"pga_me_ros.nodes.{node}").PROGRAM.parameters:
            for f in fields(kind):
                assert f.metadata["path"] == (f.name in found), f.name


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_path_argument_of_a_program_may_begin_with_a_tilde(program: str, home: Path) -> None:
    parser: Any = importlib.import_module(f"pga_me_ros.{program}.__main__")._parser()
    kinds = {action.type for action in parser._actions if isinstance(action, argparse.Action)}
    assert Path not in kinds
    for action in (a for a in parser._actions if a.type is user_path):
        assert action.type("~/x") == home / "x"


def test_no_program_takes_a_path_as_it_is() -> None:
    for path in PACKAGE.rglob("*.py"):
        assert "type=Path" not in path.read_text(), path


def test_the_library_takes_a_tilde(home: Path) -> None:
    settings = Settings(
        task="qd_hopper",
        algorithm="map_elites",
        batch_size=2,
        random_init=2,
        evaluations=2,
        cvt_samples=1024,
        controller_hidden=(4,),
    )
    task = make_task(settings.task)
    search = Search(task.spec, settings)
    search.run_generation(task)
    task.close()
    assert save_run("~/run", search).file == home / "run" / "repertoire.db"
    assert StoredRun.load("~/run").file == home / "run" / "repertoire.db"
    assert not list(Path().iterdir())


def test_folders_of_shipped_repertoires_may_begin_with_a_tilde(
    home: Path, hopper_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (home / "mine" / "walk").mkdir(parents=True)
    shutil.copy(hopper_run / "repertoire.db", home / "mine" / "walk")
    monkeypatch.setenv(VARIABLE, f"/nothing{os.pathsep}~/mine")
    assert shipped()["walk"] == home / "mine" / "walk"


def test_params_files_may_begin_with_a_tilde(home: Path) -> None:
    (home / "mine.yaml").write_text("/other: {ros__parameters: {seed: 1}}\n")
    assert find_config("~/mine.yaml") == home / "mine.yaml"
    with pytest.raises(SettingsError, match=f"{home}/mine.yaml' has nothing for node '/x'"):
        start(Program("x", "", (Settings,)), ["--ros-args", "--params-file", "~/mine.yaml"])


def test_a_home_folder_that_does_not_exist_is_named(home: Path) -> None:
    with pytest.raises(SettingsError, match="run_dir: '~nobody_of_this_name/x' begins with"):
        checked_value(_field("run_dir"), "~nobody_of_this_name/x")
    assert user_path("./~nobody_of_this_name") == Path("~nobody_of_this_name")


def test_names_of_tasks_become_names_of_files() -> None:
    assert file_name("qd_walker") == "qd_walker"
    assert file_name("Walker2d-v5") == "Walker2d-v5"
    odd = ["my/robot", "my\\robot", "my robot", "../robot", "a\nb", "my_robot"]
    names = [file_name(name) for name in odd]
    assert len(set(names)) == len(odd)
    for name in names:
        assert re.fullmatch(r"[\w.-]+", name)
        assert not name.startswith("..") or "/" not in name


def _field(name: str) -> Any:
    orchestrator = importlib.import_module("pga_me_ros.nodes.orchestrator").PROGRAM
    return next(f for kind in orchestrator.parameters for f in fields(kind) if f.name == name)


def test_a_text_lists_paths_separated_by_commas(home: Path, tmp_path: Path) -> None:
    assert listed_paths("zoo/qd_hopper, /a b/c,~/d.npz") == [
        Path("zoo/qd_hopper"),
        Path("/a b/c"),
        home / "d.npz",
    ]
    (tmp_path / "a, b").mkdir()
    assert listed_paths(str(tmp_path / "a, b")) == [tmp_path / "a, b"]
    many = [f"walk_of_seed_{k}" for k in range(600)]  # as a whole longer than any path
    assert listed_paths(", ".join(many)) == [Path(name) for name in many]
    for text in ("a,,b", "a, ", ",a", ","):
        with pytest.raises(SettingsError, match="has an empty entry; remove the comma next to it"):
            listed_paths(text)
