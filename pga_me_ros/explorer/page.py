"""The page: one HTML file with everything in it, so that it also works from a folder and without a network."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

from pga_me_ros.dependencies import require_installed
from pga_me_ros.errors import PgaError

SCRIPTS = (
    "numbers.js",
    "page.js",
    "colors.js",
    "voronoi.js",
    "store.js",
    "layouts.js",
    "map.js",
    "table.js",
    "details.js",
    "motion.js",
    "robot.js",
    "stage.js",
    "player.js",
    "curves.js",
    "live.js",
    "main.js",
)
"""The page's own scripts in the order in which they are loaded."""

_THREE = ("jupyter_threejs_sage", "static/r130/three.min.js")
"""Package and file of three.js, with its orbit controls, as one script."""


def require_web() -> None:
    """Make sure that what the page needs is installed.

    Raises:
        MissingDependencyError: It is not.
    """
    require_installed(_THREE[0], "starlette", "uvicorn")


def build_page(content: dict[str, Any]) -> str:
    """Return the page as HTML.

    Args:
        content: What it shows, fit for JSON: ``runs``, and for each of them its description, model and motions.

    Raises:
        MissingDependencyError: three.js is not installed.
    """
    require_web()
    own = files("pga_me_ros.explorer") / "web"
    parts = {
        "STYLE": (own / "page.css").read_text("utf-8"),
        "THREE": _script((files(_THREE[0]) / _THREE[1]).read_text("utf-8")),
        "SCRIPTS": "\n".join(_script((own / name).read_text("utf-8")) for name in SCRIPTS),
        "CONTENT": as_script_data(content),
        "TITLE": _text(content["title"]),
    }
    page = (own / "page.html").read_text("utf-8")
    for name, text in parts.items():
        before, mark, after = page.partition(f"<!--{name}-->")
        if not mark:
            raise PgaError(f"page.html has no place for {name}; install the package again.")
        page = before + text + after
    return page


def as_script_data(content: Any) -> str:
    """Return JSON that can stand within a script element: it holds no ``<``."""
    text = json.dumps(content, allow_nan=False, separators=(",", ":"), ensure_ascii=True)
    return text.replace("<", "\\u003c")


def write_page(content: dict[str, Any], out: Path) -> None:
    """Write the page into a file.

    Raises:
        MissingDependencyError: three.js is not installed.
        StorageError: The file cannot be written.
    """
    from pga_me_ros.core.storage.files import save_bytes

    save_bytes(out, build_page(content).encode())


def _script(text: str) -> str:
    """Return a script as an element; it must not end that element itself."""
    return f"<script>{text.replace('</script', '<' + chr(92) + '/script')}</script>"


def _text(words: str) -> str:
    return words.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
