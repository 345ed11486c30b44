"""Descriptions of parameters: the text of ``--help`` and the tables of docs/parameters.md."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import Field, fields
from typing import Any

from pga_me_ros.core.settings.field import INT64_MAX

WIDTH = 96
"""Width of the help, in characters."""


def parameter_list(*kinds: type) -> str:
    """Return one paragraph per parameter: name, default, range, unit, symbol, description.

    Args:
        kinds: Dataclasses whose fields were made by `pga_me_ros.core.settings.field.setting`.
    """
    return "".join(
        f"  {_heading(f)}\n{textwrap.fill(f.metadata['description'], WIDTH, **_INDENTED)}\n"
        for f in _fields(kinds)
    )


def parameter_table(*kinds: type) -> str:
    """Return the same as a Markdown table, one row per parameter."""
    head = (
        "| parameter | default | range | unit | symbol | set while running | meaning |\n"
        "|---|---|---|---|---|---|---|\n"
    )
    return head + "".join(_row(f) for f in _fields(kinds))


_INDENTED: dict[str, Any] = {"initial_indent": "      ", "subsequent_indent": "      "}


def _heading(f: Field[Any]) -> str:
    words = [f"{f.name}{'*' if f.metadata['rate'] else ''} = {shown(f.default)}"]
    if f.metadata["unit"]:
        words[0] += f" {f.metadata['unit']}"
    if allowed(f):
        words.append(allowed(f))
    if f.metadata["symbol"]:
        words.append(f"paper: {f.metadata['symbol']}")
    return "; ".join(words)


def _row(f: Field[Any]) -> str:
    meta = f.metadata
    cells = [
        f"`{f.name}`",
        f"`{shown(f.default)}`",
        allowed(f),
        meta["unit"],
        meta["symbol"],
        "yes" if meta["rate"] else "",
        meta["description"],
    ]
    return "| " + " | ".join(cells).replace("  ", " ") + " |\n"


def _fields(kinds: tuple[type, ...]) -> Iterator[Field[Any]]:
    for kind in kinds:
        yield from fields(kind)


def shown(value: Any) -> str:
    """Return a value as it is written on a command line and in YAML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return str(list(value))
    return "''" if value == "" else str(value)


def allowed(f: Field[Any]) -> str:
    """Return which values a setting may have; empty if any."""
    meta = f.metadata
    if meta["choices"]:
        return " or ".join(meta["choices"])
    if meta["low"] is None:
        return ""
    each = " each" if isinstance(f.default, tuple) else ""
    high = "2^63 - 1" if meta["high"] == INT64_MAX else meta["high"]
    return f"{meta['low']} to {high}{each}"
