"""Hook of mkdocs: makes a page for each source file that a page of docs/ links to.

Links such as ``../pga_me_ros/core/rng.py`` work on the repository's web page; on the site they lead to these pages.
"""

from __future__ import annotations

import ast
import logging
import os
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
LINK = re.compile(r"(?<=\]\()((?:\.\./)+[^)#]+)(?:#[^)]*)?(?=\))")
SOURCE = "source/"
LOG = logging.getLogger("mkdocs.hooks.site_docs")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every file and folder outside docs/ that is linked to."""
    pages = list(files.documentation_pages())
    links = [(page.src_uri, link) for page in pages for link in LINK.findall(page.content_string)]
    targets = {target for source, link in links if (target := _outside(source, link))}
    for target in sorted(targets):
        path = ROOT / target
        if path.exists():
            text = f"---\nsearch:\n  exclude: true\n---\n\n# {target}\n\n{_shown(path)}\n"
            files.append(File.generated(config, _page_of(target), content=text))
        else:
            LOG.warning("a page links to '%s', which does not exist", target)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Make links to source files point to their pages; source files themselves are shown unchanged."""
    uri = page.file.src_uri
    if uri.startswith(SOURCE):
        return markdown

    def to_page(link: re.Match[str]) -> str:
        target = _outside(uri, link[1])
        return "../" * uri.count("/") + _page_of(target) if target else link[0]

    return LINK.sub(to_page, markdown)


def _outside(source: str, link: str) -> str | None:
    """Return the path within the repository that a page of docs/ links to, None if it is within docs/."""
    path = Path(os.path.normpath(DOCS / Path(source).parent / link))
    return None if path.is_relative_to(DOCS) else path.relative_to(ROOT).as_posix()


def _page_of(target: str) -> str:
    return f"{SOURCE}{target}.md"


def _shown(path: Path) -> str:
    if path.is_file():
        return f"~~~~~~ {path.suffix[1:]}\n{path.read_text()}\n~~~~~~"
    return "\n".join(f"- `{file.name}`: {_first_line(file)}" for file in sorted(path.glob("*.py")))


def _first_line(file: Path) -> str:
    return (ast.get_docstring(ast.parse(file.read_text())) or "").partition("\n")[0]
