"""What the explorer's command line does not take."""

from __future__ import annotations

from pathlib import Path

import pytest
from browsing import ZOO

from pga_me_ros import dependencies
from pga_me_ros.dependencies import WEB
from pga_me_ros.explorer.__main__ import main


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--html", "page.txt"], "ends in .html"),
        (["--html", "nowhere/page.html"], "make it first"),
        (["--html", "page.html", "--randomization", "wind 1 2"], "KIND is one of"),
        (["--html", "page.html", "--port", "0"], "--port has a meaning not with --html"),
        (["--html", "/proc/page.html"], "'/proc/page.html' cannot be written"),
        (["--html", "page.html", "--ros-args", "-r", "__ns:=/a"], "-r __ns:=/a' is for a graph"),
        (["--html", "page.html", "--graph", "/"], "--html writes stored runs only"),
        (["--motions", "3"], "--motions has a meaning only with --html"),
        (["--damage", "ice"], "--damage has a meaning only with --html"),
        (["--graph", "left"], "'left' does not begin with a slash; expected --graph /left"),
        (["--graph", "/a", "--graph", "/b"], "3 are named, but a page shows one or two"),
        ([ZOO], "is the same run as"),
        ([ZOO, "--html", "page.html"], "is the same run as"),
        (["--ros-args", "-r", "__ns:=/left"], "only stored runs are named"),
    ],
)
def test_bad_arguments_are_told_in_one_line(
    args: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([ZOO, *args]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_told_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dependencies, "find_spec", lambda name: None)
    assert main([ZOO, "--html", str(tmp_path / "page.html")]) == 2
    assert f"pip install {WEB}" in capsys.readouterr().err
