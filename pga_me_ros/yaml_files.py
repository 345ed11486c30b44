"""YAML files of users, read so that every mistake names the file and the line, and no key is given twice."""

from __future__ import annotations

import json
import shlex
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from pga_me_ros.errors import SettingsError, nearest_name


class _Loader(yaml.SafeLoader):
    """Refuses a key that is given twice, for which YAML would silently use the last value."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for place, key in enumerate(keys):
            if key in keys[:place]:
                mark = node.value[place][0].start_mark
                raise yaml.constructor.ConstructorError(
                    problem=f"'{key}' is given twice", problem_mark=mark
                )
        return super().construct_mapping(node, deep)


def parameter(name: str, value: Any) -> str:
    """Return ``name:=value`` as a node reads it after ``-p``, whatever a text holds: JSON is YAML."""
    return f"{name}:={json.dumps(value)}"


def parameter_word(name: str, text: str) -> str:
    """Return ``name:=text``, quoted for a shell and for the YAML that ROS 2 reads after ``-p``."""
    try:
        plain = yaml.safe_load(text) == text
    except yaml.YAMLError:
        plain = False
    return shlex.quote(f"{name}:={text}" if plain else parameter(name, text))


def read_yaml(path: Path, what: str, layout: str) -> Any:
    """Return the content of a YAML file.

    Args:
        path: The file.
        what: What it is called in messages, for example ``experiment file``.
        layout: What it should look like, for messages about broken YAML.

    Raises:
        SettingsError: The file is missing, cannot be read, is not YAML, or gives a key twice.
    """
    name = what.capitalize()
    try:
        return yaml.load(path.read_text(), _Loader)
    except FileNotFoundError:
        near = nearest_name(path.name, [p.name for p in path.parent.glob("*.yaml")])
        raise SettingsError(
            f"There is no {what} '{path}'{near}; give the path of a YAML file."
        ) from None
    except OSError as error:
        raise SettingsError(
            f"{name} '{path}' cannot be read ({error.strerror}); give the path of a YAML file."
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError, TypeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        raise SettingsError(
            f"{name} '{path}' is not valid YAML{where}: {problem}; {layout}."
        ) from None
