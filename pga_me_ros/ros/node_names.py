"""Names of nodes and namespaces on the command line, checked so that errors say what is wrong with them."""

from __future__ import annotations

import re

from pga_me_ros.errors import SettingsError

TOKEN = r"[A-Za-z_][A-Za-z0-9_]*"
"""A node name, or a part of a namespace."""

RENAMES_NODE = r"(?:[^:]+:)?__(ns|node|name):=(.*)"
"""Remapping of a namespace or node name."""

EXPECTED = "letters, digits and single underscores only, and no digit first"


def require_valid_name(rule: str) -> None:
    """Refuse a remapping to a namespace or node name that ROS 2 does not allow.

    Args:
        rule: Remapping such as ``__ns:=/left``; others are not looked at.

    Raises:
        SettingsError: The name is invalid; the message has a valid one.
    """
    found = re.fullmatch(RENAMES_NODE, rule)
    if not found:
        return
    kind, name = found.groups()
    parts = _valid_parts(name)
    if kind == "ns":
        require_valid_namespace(name, "-r __ns:=")
    elif [name] != parts:
        valid = "_".join(parts) or "NAME"
        fault = _fault(f"/{name}") if "/" not in name and name else "is no single name"
        raise SettingsError(f"Node name '{name}' {fault}; expected -r __{kind}:={valid}")


def require_valid_namespace(name: str, option: str) -> None:
    """Refuse a namespace that ROS 2 does not allow.

    Args:
        name: The namespace; ``/`` is that without a name.
        option: What it is given with, for the message.

    Raises:
        SettingsError: It is invalid; the message has a valid one.
    """
    valid = "/" + "/".join(_valid_parts(name))
    if name != valid:
        raise SettingsError(f"Namespace '{name}' {_fault(name)}; expected {option}{valid}")


def _valid_parts(name: str) -> list[str]:
    """Return the parts between slashes with everything replaced that ROS 2 does not allow."""
    parts = [
        re.sub(r"_+", "_", re.sub(r"\W", "_", p, flags=re.ASCII)) for p in name.split("/") if p
    ]
    return [f"_{part}" if part[0].isdigit() else part for part in parts]


def _fault(namespace: str) -> str:
    """Return what is wrong with a namespace."""
    if not namespace.startswith("/"):
        return "does not begin with a slash"
    if namespace.endswith("/"):
        return "ends with a slash"
    if "//" in namespace:
        return "has two slashes in a row"
    bad = next((c for c in namespace if not re.fullmatch(r"\w|/", c, flags=re.ASCII)), "")
    if bad:
        return f"has a '{bad}', but names have {EXPECTED}"
    return f"is invalid: names have {EXPECTED}"
