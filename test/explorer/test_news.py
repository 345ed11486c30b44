"""News that the live page gets at a bad moment: none is lost, and none takes other warnings away."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from serving import Server, replace, started

from pga_me_ros.core.storage.stored_run import StoredRun

ELITES = "Explorer.state.runs[0].elites.length"


@pytest.fixture
def folder(hopper_run: Path, tmp_path: Path) -> Path:
    """Return a copy of a run that the tests may change."""
    return Path(shutil.copytree(hopper_run, tmp_path / "run"))


@pytest.fixture
def server(folder: Path) -> Iterator[Server]:
    server = started(str(folder))
    yield server
    server.process.kill()
    server.process.communicate()


def test_what_could_not_be_fetched_is_fetched_again(
    folder: Path, server: Server, longer_run: Path, pages: Callable[..., Any]
) -> None:
    page = pages(server.address)
    page.page.route("**/api/run/0", lambda route: route.abort(), times=1)
    replace(longer_run / "repertoire.db", folder / "repertoire.db")
    page.wait(f"{ELITES} === {len(StoredRun.load(longer_run).archive)}")
    assert page.page.is_hidden("#message")


def test_news_that_come_during_a_fetch_are_not_lost(
    folder: Path, server: Server, longer_run: Path, hopper_run: Path, pages: Callable[..., Any]
) -> None:
    page = pages(server.address)
    held: list[Any] = []
    page.page.route("**/api/run/0", lambda route: held.append(route), times=1)
    replace(longer_run / "repertoire.db", folder / "repertoire.db")
    page.wait("Live.state()[0].version === 1")
    _, older = server.get("api/run/0")
    replace(hopper_run / "repertoire.db", folder / "repertoire.db")
    page.wait("Live.state()[0].version === 2")
    held[0].fulfill(body=older, content_type="application/json")
    page.wait(f"{ELITES} === {len(StoredRun.load(hopper_run).archive)}")
    assert json.loads(older)["version"] == 1


def test_news_leave_the_warning_about_a_link(server: Server, pages: Callable[..., Any]) -> None:
    page = pages(f"{server.address}#cell=99999")
    page.wait("Live.state().length > 0")
    assert "Cell 99999, which the link names" in page.page.inner_text("#message")
    page.page.locator("#maps path.elite:not(.chosen)").first.click(force=True)
    page.page.locator("#maps path.elite:not(.chosen)").last.click(force=True)
    assert page.page.is_hidden("#message")
