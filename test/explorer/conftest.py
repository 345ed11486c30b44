"""One browser for all tests of the page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browsing import Page, running_browser


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Return a headless Chromium, driven by Playwright."""
    with running_browser() as running:
        yield running


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
