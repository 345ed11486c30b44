"""Params files, checked before ROS 2 reads them, so that errors name the file and the line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pga_me_ros.errors import SettingsError, nearest_name

PARAMETERS = "ros__parameters"

EXPECTED = "expected a section '/**:' with a key 'ros__parameters:' with 'name: value' lines"


def sections(path: Path) -> list[str]:
    """Return the node names, wildcards included, that a params file has parameters for; see `entries`."""
    return [name for name, _ in entries(path)]


def entries(path: Path) -> list[tuple[str, Mapping[str, Any]]]:
    """Return node names, wildcards included, and the parameters that a params file has for each.

    Args:
        path: YAML file in the layout of ROS 2.

    Raises:
        SettingsError: The file is missing, unreadable, not YAML, or has another layout.
    """
    content = _read(path)
    if not isinstance(content, Mapping):
        raise SettingsError(f"Params file '{path}' names no node; {EXPECTED}.")
    return _sections(path, content, "")


def matches(section: str, node: str) -> bool:
    """Whether a section of a params file is meant for a node.

    Args:
        section: Key such as ``/**``, ``/**/orchestrator`` or ``orchestrator``.
        node: Fully qualified name of the node.
    """
    pattern = re.escape("/" + section.strip("/"))
    pattern = pattern.replace(r"/\*\*", "(/[^/]+)*").replace(r"\*", "[^/]+")
    return re.fullmatch(pattern, node) is not None


def _read(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text())
    except FileNotFoundError:
        near = nearest_name(path.name, [p.name for p in path.parent.glob("*.yaml")])
        raise SettingsError(
            f"There is no params file '{path}'{near}; give the path of a YAML file."
        ) from None
    except OSError as error:
        raise SettingsError(
            f"Params file '{path}' cannot be read ({error.strerror}); give the path of a YAML file."
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        raise SettingsError(
            f"Params file '{path}' is not valid YAML{where}: {problem}; {EXPECTED}."
        ) from None


def _sections(
    path: Path, content: Mapping[Any, Any], inside: str
) -> list[tuple[str, Mapping[str, Any]]]:
    found: list[tuple[str, Mapping[str, Any]]] = []
    for key, value in content.items():
        name = f"{inside}/{key}".replace("//", "/")
        if not isinstance(value, Mapping):
            raise SettingsError(
                f"Params file '{path}' has a value for '{name}' outside '{PARAMETERS}'; {EXPECTED}."
            )
        if PARAMETERS not in value:
            found += _sections(path, value, name)
        elif isinstance(value[PARAMETERS], Mapping) and value[PARAMETERS]:
            found.append((name, value[PARAMETERS]))
        else:
            raise SettingsError(
                f"Params file '{path}' has no parameters below '{name}'; {EXPECTED}."
            )
    return found
