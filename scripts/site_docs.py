"""Hook of mkdocs: makes a page of each source file that a page of docs/ links to.

Links such as ``../pga_me_ros/core/rng.py`` hold on the repository's web page; in the site they lead to these pages.
"""

from __future__ import annotations

import ast
import logging
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(?<=\]\()\.\./([^)#]+)(?:#[^)]*)?(?=\))")
LOG = logging.getLogger("mkdocs.hooks.site_docs")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every file and folder outside docs/ that is linked to."""
    pages = [file for file in files.documentation_pages() if "/" not in file.src_uri]
    targets = {target for page in pages for target in LINK.findall(page.content_string)}
    for target in sorted(targets):
        path = ROOT / target
        if path.exists():
            text = f"---\nsearch:\n  exclude: true\n---\n\n# {target}\n\n{_shown(path)}\n"
            files.append(File.generated(config, _page_of(target), content=text))
        else:
            LOG.warning("a page links to '../%s', which does not exist", target)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links to source files at their pages."""
    return LINK.sub(lambda link: _page_of(link[1]), markdown)


def _page_of(target: str) -> str:
    return f"source/{target.rstrip('/')}.md"


def _shown(path: Path) -> str:
    if path.is_file():
        return f"~~~~~~ {path.suffix[1:]}\n{path.read_text()}\n~~~~~~"
    return "\n".join(f"- `{file.name}`: {_first_line(file)}" for file in sorted(path.glob("*.py")))


def _first_line(file: Path) -> str:
    return (ast.get_docstring(ast.parse(file.read_text())) or "").partition("\n")[0]
