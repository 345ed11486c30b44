"""A real browser for tests of pages: Chromium, driven by Playwright."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

FLAGS = (
    # As root, and without a graphics card; the rest keeps Chromium from looking for its maker's servers.
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)

ZOO = "zoo/qd_hopper"
"""The repertoire of `hopper_page`."""

UNSEEN_SEED = 3
"""Seed of the unseen start in `hopper_file`."""

RANDOMIZATION = "mass 0.8 1.2, friction 0.6"
"""What is randomized in its third start."""

DAMAGE = "gone foot_joint"
"""What is wrong with the robot in its fourth start."""

NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def running_browser() -> Iterator[Any]:
    """Provide a headless Chromium; skips the test where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="Playwright drives the browser")
    with api.sync_playwright() as playwright, launched(playwright.chromium) as running:
        yield running


@contextmanager
def launched(kind: Any, *flags: str) -> Iterator[Any]:
    """Provide a headless Chromium with some flags in addition; skips the test where there is none.

    Args:
        kind: Playwright's type of browser.
        flags: Further flags of its command line.
    """
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("There is no Chromium; on Debian: apt-get install chromium")
    # The libraries of the ROS wheels are not for the browser.
    clean = {k: v for k, v in os.environ.items() if k != "LD_LIBRARY_PATH"}
    running = kind.launch(executable_path=found, args=[*FLAGS, *flags], env=clean)
    yield running
    running.close()


class Page:
    """A page that is open, and what went wrong on it.

    Attributes:
        page: Playwright's page.
        problems: Errors in its scripts, messages on its console.
        requests: Addresses that it asked for.
    """

    def __init__(self, browser: Any, address: str, **options: Any) -> None:
        options.setdefault("viewport", {"width": 1280, "height": 900})
        options.setdefault("reduced_motion", "reduce")  # nothing moves by itself
        self.context = browser.new_context(**options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(30_000)
        self.problems: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", lambda message: self.problems.append(message.text))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.open(address)

    def open(self, address: str) -> None:
        """Go to an address and wait for the page."""
        self.page.goto(address)
        self.page.wait_for_selector("#figures dt")

    def figures(self) -> dict[str, str]:
        """Return what the page says about the chosen gait."""
        terms = self.page.locator("#figures dt").all_inner_texts()
        texts = self.page.locator("#figures dd").all_inner_texts()
        return dict(zip(terms, texts, strict=True))

    def wait(self, condition: str, seconds: float = 30.0) -> None:
        """Wait until an expression is true; the page's own policy forbids Playwright's way, which evaluates text."""
        end = time.monotonic() + seconds
        while not self.page.evaluate(condition):
            assert time.monotonic() < end, f"{condition} has not come true; {self.problems}"
            self.page.wait_for_timeout(20)

    def choose(self, cell: int) -> None:
        """Click at a cell of the map."""
        self.page.locator(f'#maps path[data-cell="{cell}"]').click(force=True)

    def plays(self, cell: int) -> None:
        """Wait until the gait of a cell is on the stage."""
        self.wait(f"Explorer.view().cells[0] === {cell}")

    def picture(self) -> bytes:
        """Return what the stage shows once all that was changed is drawn."""
        self.page.evaluate(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        shot: bytes = self.page.locator("#stage").screenshot()
        return shot

    def eval(self, script: str, *values: Any) -> Any:
        """Return the value of an expression of the page, or of a function for a value."""
        return self.page.evaluate(script, *values)

    def close(self) -> None:
        """Close the page."""
        self.context.close()
