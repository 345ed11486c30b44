"""The site of docs/ is complete, up to date, and needs no network."""

from __future__ import annotations

import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

from pga_me_ros.ros import names

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import interface_docs

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site; --strict makes broken links and anchors fail (unless --quiet hides the warnings)."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return folder


def pages() -> list[str]:
    """Return the pages of docs/ without their suffix, relative to docs/."""
    docs = ROOT / "docs"
    return [page.relative_to(docs).with_suffix("").as_posix() for page in docs.rglob("*.md")]


def test_every_page_is_in_the_site_and_once_in_its_menu(site: Path) -> None:
    listed = re.findall(r"(\S+)\.md$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(pages())
    menu = (site / "index.html").read_text()
    for page in pages():
        assert (site / f"{page}.html").exists()
        assert f'href="{page}.html"' in menu, page


@pytest.mark.parametrize(
    ("page", "link"),
    [
        ("design", "source/pga_me_ros/core/rng.py.html"),
        ("decisions/0010-events-executor", "../source/pga_me_ros/ros/spinning.py.html"),
    ],
)
def test_links_to_sources_lead_to_their_text(site: Path, page: str, link: str) -> None:
    html = site / f"{page}.html"
    assert f'href="{link}"' in html.read_text()
    source = ROOT / link.removeprefix("../").removeprefix("source/").removesuffix(".html")
    shown = unescape(re.sub("<[^>]*>", "", (html.parent / link).read_text()))
    assert source.read_text().strip() in shown


def test_long_commands_wrap_and_can_be_copied(site: Path) -> None:
    page = (site / "behavior_player.html").read_text()
    assert 'href="stylesheets/code.css"' in page
    assert "content.code.copy" in page
    assert page.count('<div class="language-text highlight">') == page.count("<pre>")
    assert '<div class="language-bash highlight">' in (site / "tutorial.html").read_text()
    style = (site / "stylesheets/code.css").read_text()
    assert ".language-text pre > code" in style
    assert ".language-bash pre > code" in style
    assert "white-space: pre-wrap" in style


def test_nothing_is_loaded_from_other_sites(site: Path) -> None:
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


@pytest.mark.parametrize(
    "path", sorted((ROOT / "msg_defs").rglob("*.[ms][sr][gv]")), ids=lambda p: p.stem
)
def test_every_field_of_a_message_is_explained_right_above_it(path: Path) -> None:
    above = ""
    for line in path.read_text().splitlines():
        if line and line != "---" and not line.startswith("#"):
            assert above.startswith("# "), line
            assert "#" not in line, "the comment belongs above the field"
        above = line
