"""The site of docs/: whole, up to date, and complete without a network."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from pga_me_ros.ros import names

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import interface_docs

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site; strict: a broken link or anchor fails (not with --quiet, which hides warnings from it, too)."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return folder


def test_every_page_is_in_the_site_and_its_menu(site: Path) -> None:
    menu = (site / "index.html").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        assert (site / f"{page.stem}.html").exists()
        assert f'href="{page.stem}.html"' in menu, page


def test_links_to_sources_lead_to_their_text(site: Path) -> None:
    assert 'href="source/pga_me_ros/core/rng.py.html"' in (site / "design.html").read_text()
    assert "def generator" in re.sub(
        "<[^>]*>", "", (site / "source/pga_me_ros/core/rng.py.html").read_text()
    )


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    fetched = re.compile(r'<(?:script|img|link)\b[^>]*\b(?:src|href)="(?:https?:)?//')
    pages = list(site.rglob("*.html"))
    assert pages
    assert [page for page in pages if fetched.search(page.read_text())] == []


def test_the_interface_page_is_up_to_date() -> None:
    assert (ROOT / "docs" / "interface.md").read_text() == interface_docs.page(), "run: make docs"


def test_the_interface_page_has_every_name() -> None:
    offered = {offer.name for offer in interface_docs.offers()}
    every = {value for name, value in vars(names).items() if name.isupper()}
    assert every - offered == set()
