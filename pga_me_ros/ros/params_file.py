"""Params files, checked before ROS 2 reads them, so that errors name the file and the line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pga_me_ros.errors import SettingsError
from pga_me_ros.yaml_files import read_yaml

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
        SettingsError: The file is missing, unreadable, not YAML, gives a key twice, or has another layout.
    """
    content = read_yaml(path, "params file", EXPECTED)
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
