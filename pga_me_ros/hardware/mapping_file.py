"""Reads mapping files; every mistake in them is named in one line."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from pga_me_ros.errors import SettingsError, nearest_name
from pga_me_ros.hardware.fields import ARRAY, JOINTS, TYPES, field_names
from pga_me_ros.hardware.mapping import Entry, Joint, RobotMapping, Source
from pga_me_ros.yaml_files import read_yaml

LAYOUT = (
    "expected the keys task, sources, observation and commands; docs/hardware.md describes them"
)

FUNCTIONS = ("sin", "cos")

Section = Mapping[str, Any]


def read_mapping(path: Path) -> RobotMapping:
    """Read a mapping file and check all of it that needs no controller.

    Raises:
        SettingsError: The file is missing, is not YAML, or has an invalid key or value.
    """
    content = read_yaml(path, "mapping", LAYOUT)
    try:
        return _mapping(path, content)
    except SettingsError as error:
        raise SettingsError(f"Mapping '{path}': {error}") from None


def _mapping(path: Path, content: Any) -> RobotMapping:
    top = _section("it", content, ("task", "sources", "observation", "commands"))
    sources = {
        name: _source(f"sources {name}", given) for name, given in _named(top, "sources").items()
    }
    entries = {
        name: _entry(f"observation {name}", given, sources)
        for name, given in _named(top, "observation").items()
    }
    commands = _section("commands", top["commands"], ("topic", "kind", "joints"))
    kind = _choice("commands", commands, "kind", ("effort", "position"))
    make = _position if kind == "position" else _effort
    joints = tuple(
        make(f"commands {name}", name, given) for name, given in _named(commands, "joints").items()
    )
    if kind == "position" and [s.type for s in sources.values()].count(JOINTS) != 1:
        raise SettingsError(
            f"commands of kind position start from the measured positions; give one source of {JOINTS}."
        )
    used = {e.source for e in entries.values()}
    if kind == "position":
        used |= {name for name, source in sources.items() if source.type == JOINTS}
    for name in sources:
        if name not in used:
            raise SettingsError(f"sources has '{name}', which no entry of the observation uses.")
    topic = _text("commands", commands, "topic")
    return RobotMapping(
        path, _text("it", top, "task"), sources, entries, topic, kind == "position", joints
    )


def _source(where: str, given: Any) -> Source:
    section = _section(where, given, ("topic", "type"), ("reliable", "timeout"))
    reliable = section.get("reliable", False)
    if not isinstance(reliable, bool):
        raise SettingsError(f"{where}: reliable is {reliable!r}; give true or false.")
    kind = _choice(where, section, "type", tuple(TYPES))
    timeout = _positive(where, section, "timeout") if "timeout" in section else None
    return Source(_text(where, section, "topic"), kind, reliable, timeout)


def _entry(where: str, given: Any, sources: Mapping[str, Source]) -> Entry:
    if isinstance(given, Mapping) and "constant" in given:
        section = _section(where, given, ("constant",))
        return Entry("", "", "", 0.0, _number(where, section, "constant"), "", None, 0)
    optional = ("field", "joint", "index", "scale", "offset", "function", "low", "high", "delay")
    section = _section(where, given, ("source",), optional)
    source = _choice(where, section, "source", tuple(sources))
    kind = sources[source].type
    known = field_names(kind)
    field = known[0] if known == ("data",) and "field" not in section else ""
    field = field or _choice(where, section, "field", known)
    for key, owner in (("joint", JOINTS), ("index", ARRAY)):
        if (key in section) != (kind == owner):
            verb = "needs" if kind == owner else "takes no"
            raise SettingsError(f"{where}: a field of {kind} {verb} {key}.")
    part = _text(where, section, "joint") if kind == JOINTS else ""
    if kind == ARRAY:
        part = str(_count(where, section, "index"))
    function = _choice(where, section, "function", FUNCTIONS) if "function" in section else ""
    return Entry(
        source=source,
        part=part,
        field=field,
        scale=_number(where, section, "scale", 1.0),
        offset=_number(where, section, "offset", 0.0),
        function=function,
        limits=_limits(where, section) if "low" in section or "high" in section else None,
        delay=_count(where, section, "delay"),
    )


def _effort(where: str, name: str, given: Any) -> Joint:
    section = _section(where, given, ("action", "scale", "limit", "rate"))
    limit, rate = _positive(where, section, "limit"), _positive(where, section, "rate")
    scale = _number(where, section, "scale")
    return Joint(name, _text(where, section, "action"), scale, 0.0, -limit, limit, rate)


def _position(where: str, name: str, given: Any) -> Joint:
    section = _section(where, given, ("action", "low", "high", "rate"))
    low, high = _limits(where, section)
    scale, offset = 0.5 * (high - low), 0.5 * (high + low)
    rate = _positive(where, section, "rate")
    return Joint(name, _text(where, section, "action"), scale, offset, low, high, rate)


def _section(
    where: str, given: Any, required: Collection[str], optional: Collection[str] = ()
) -> Section:
    """Return a section of the file that has all required keys and no unknown one."""
    known = (*required, *optional)
    if not isinstance(given, Mapping):
        raise SettingsError(f"{where} is {given!r}; expected the keys {', '.join(known)}.")
    for key in given:
        if key not in known:
            raise SettingsError(
                f"{where} has an unknown key '{key}'{nearest_name(str(key), known)}; expected {', '.join(known)}."
            )
    missing = [key for key in required if key not in given]
    if missing:
        raise SettingsError(f"{where} lacks {', '.join(missing)}.")
    return given


def _named(section: Section, key: str) -> Section:
    given = section[key]
    if not isinstance(given, Mapping) or not given or not all(isinstance(n, str) for n in given):
        raise SettingsError(f"{key} is {given!r}; expected at least one name with its keys.")
    return given


def _limits(where: str, section: Section) -> tuple[float, float]:
    low, high = _number(where, section, "low"), _number(where, section, "high")
    if low >= high:
        raise SettingsError(f"{where}: low is {low:g} and high is {high:g}; give low < high.")
    return low, high


def _text(where: str, section: Section, key: str) -> str:
    given = section[key]
    if not isinstance(given, str) or not given:
        raise SettingsError(f"{where}: {key} is {given!r}; give a name.")
    return given


def _choice(where: str, section: Section, key: str, known: Sequence[str]) -> str:
    given = section.get(key)
    if given not in known:
        near = nearest_name(str(given), known)
        raise SettingsError(f"{where}: {key} is {given!r}{near}; expected {' or '.join(known)}.")
    return str(given)


def _number(where: str, section: Section, key: str, default: float | None = None) -> float:
    given = section.get(key, default)
    fits = isinstance(given, int | float) and not isinstance(given, bool)
    if not fits or not math.isfinite(given):
        raise SettingsError(f"{where}: {key} is {given!r}; give a finite number.")
    return float(given)


def _positive(where: str, section: Section, key: str) -> float:
    given = _number(where, section, key)
    if given <= 0.0:
        raise SettingsError(f"{where}: {key} is {given:g}; give a number above 0.")
    return given


def _count(where: str, section: Section, key: str) -> int:
    given = section.get(key, 0)
    if type(given) is not int or given < 0:
        raise SettingsError(f"{where}: {key} is {given!r}; give a whole number from 0 on.")
    return given
