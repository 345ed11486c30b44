"""Fields of settings dataclasses: what each setting means and which values it may have."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pga_me_ros.errors import SettingsError, nearest_name
from pga_me_ros.paths import expanded, listed_paths

INT64_MAX = 2**63 - 1


def setting(
    default: Any,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    unit: str = "",
    symbol: str = "",
    rate: bool = False,
    identity: bool = True,
    part: str = "",
    own: bool = False,
    path: bool = False,
    several: bool = False,
) -> Any:
    """Declare a field of a settings dataclass.

    Args:
        default: Value if none is given; its type is the setting's type. An empty tuple stands for any number of
            floats.
        description: One sentence for people.
        low: Least allowed value (each entry, for a tuple).
        high: Greatest allowed value.
        choices: Allowed strings; empty for any.
        unit: SI unit or noun, empty for a pure number.
        symbol: Symbol in the paper, empty when it has none.
        rate: Whether it may change while the run is under way (from the next generation on).
        identity: Whether it is part of what the run is, so that a resumed run must have the same.
        part: Kind of archive, or part of an algorithm, that it configures (see `core.settings.rules`); empty when every
            run uses it.
        own: Whether the default stands for the algorithm's own value.
        path: Whether it names a file or folder; a ``~`` at its beginning is expanded.
        several: Whether it may name several of them, see `pga_me_ros.paths.listed_paths`.
    """
    meta = {
        "description": description,
        "low": low,
        "high": high,
        "choices": choices,
        "unit": unit,
        "symbol": symbol,
        "rate": rate,
        "identity": identity,
        "part": part,
        "own": own,
        "path": path,
        "several": several,
    }
    return dataclasses.field(default=default, metadata=meta)


def checked_value(f: dataclasses.Field[Any], value: Any) -> Any:
    """Return the value of a settings field in its own type, or raise.

    Args:
        f: Field declared by `setting`.
        value: Candidate.

    Raises:
        SettingsError: The value has the wrong type or is out of range.
    """
    if isinstance(f.default, tuple):
        kind = type(f.default[0]) if f.default else float
        if isinstance(value, (str, bytes)) or not hasattr(value, "__iter__"):
            entries_are = "integers" if kind is int else "numbers"
            raise SettingsError(f"{f.name} must be a list of {entries_are}, not {value!r}.")
        entries = tuple(_checked_scalar(f, v, kind) for v in value)
        if f.default and not entries:
            raise SettingsError(f"{f.name} must name at least one layer, for example [128, 128].")
        return entries
    return _checked_scalar(f, value, type(f.default))


def _checked_scalar(f: dataclasses.Field[Any], value: Any, kind: type) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind is int and isinstance(value, float) and value.is_integer():
        value = int(value)  # 1e6 is how people write a million
    if type(value) is not kind:
        wanted = {int: "an integer", float: "a number", str: "a string", bool: "true or false"}
        raise SettingsError(
            f"{f.name} must be {wanted[kind]}, not {value!r} ({type(value).__name__})"
            + (_as_text(f, value) if kind is str else ".")
        )
    if isinstance(value, float) and math.isnan(value):
        raise SettingsError(f"{f.name} is {value}; expected a number.")
    meta = f.metadata
    if meta["path"]:
        value = _expanded(f, str(value))
    if meta["choices"] and value not in meta["choices"]:
        choices = ", ".join(meta["choices"])
        raise SettingsError(
            f"{f.name} is {value!r}{nearest_name(str(value), meta['choices'])}; expected one of: {choices}."
        )
    low, high = meta["low"], meta["high"]
    if low is not None and not low <= value <= high:
        raise SettingsError(
            f"{f.name} is {value}; expected a value from {low} to {high}{_unit(meta)}."
        )
    return value


def _as_text(f: dataclasses.Field[Any], value: Any) -> str:
    """Return how to write a value as the text that a field wants."""
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        return f"; put it in quotes: {f.name}:=\"'{value}'\"."
    several = f.metadata["several"] and all(isinstance(entry, str) for entry in value)
    return f'; write {f.name}: "{", ".join(value)}".' if several else "."


def named_paths(f: dataclasses.Field[Any], value: Any) -> list[Path]:
    """Return the files or folders that a value of a settings field names, none for a field of another kind.

    Raises:
        SettingsError: As for `pga_me_ros.paths.listed_paths`, where the field may name several.
    """
    if not f.metadata["path"] or not value:
        return []
    return listed_paths(value) if f.metadata["several"] else [Path(value)]


def _expanded(f: dataclasses.Field[Any], text: str) -> str:
    try:
        named_paths(f, text)  # each is checked
        return expanded(text)
    except SettingsError as error:
        raise SettingsError(f"{f.name}: {error}") from None


def _unit(meta: Mapping[str, Any]) -> str:
    return f" {meta['unit']}" if meta["unit"] else ""
