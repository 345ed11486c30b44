"""Pages of repertoires for the tests of the explorer, among them one that comes with the package."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from browsing import DAMAGE, RANDOMIZATION, UNSEEN_SEED, ZOO, Page

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer.__main__ import main


@pytest.fixture(scope="session")
def pages(browser: Any) -> Iterator[Any]:
    """Return a function that opens a page, closed at the end of all tests."""
    opened: list[Page] = []

    def show(address: str | Path, **options: Any) -> Page:
        url = address if isinstance(address, str) else address.resolve().as_uri()
        opened.append(Page(browser, url, **options))
        return opened[-1]

    yield show
    for page in opened:
        page.close()


@pytest.fixture(scope="session")
def other_run(new_run: Callable[..., Path]) -> Path:
    """Return the folder of a run like `hopper_run` with another seed; only read it."""
    return new_run(seed=6)


@pytest.fixture(scope="session")
def page_of_two(
    hopper_run: Path, other_run: Path, pages: Any, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[int], Page]:
    """Return a function that opens a page of two runs with the same cells, and with so many gaits in motion."""

    def show(motions: int) -> Page:
        out = tmp_path_factory.mktemp("two") / "two.html"
        words = [str(hopper_run), str(other_run), "--html", str(out), "--motions", str(motions)]
        assert main(words) == 0
        shown: Page = pages(out, offline=True)
        return shown

    return show


@pytest.fixture(scope="session")
def longer_run(new_run: Callable[..., Path]) -> Path:
    """Return the folder of a run like `hopper_run` that went on for two generations; only read it."""
    return new_run(evaluations=40)


@pytest.fixture(scope="session")
def hopper_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a page in one file, with three gaits in motion."""
    out = tmp_path_factory.mktemp("page") / "hopper.html"
    words = ["--motions", "3", "--seed", str(UNSEEN_SEED)]
    words += ["--randomization", RANDOMIZATION, "--damage", DAMAGE]
    assert main([ZOO, "--html", str(out), *words]) == 0
    return out


@pytest.fixture(scope="session")
def hopper_page(hopper_file: Path, pages: Any) -> Page:
    """Return this file, open without a network."""
    shown: Page = pages(hopper_file, offline=True)
    return shown


@pytest.fixture
def page(hopper_page: Page) -> Iterator[Any]:
    """Return this page; fails a test in which it complained, or asked for anything but its file."""
    yield hopper_page
    assert hopper_page.problems == []
    own = ("file:", "data:", "blob:")
    assert [url for url in hopper_page.requests if not url.startswith(own)] == []


@pytest.fixture(scope="session")
def run() -> StoredRun:
    """Return the repertoire that this page shows."""
    return StoredRun.load(ZOO)
