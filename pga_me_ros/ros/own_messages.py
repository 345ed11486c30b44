"""A check that the pga_me_msgs that Python imports has all that the definitions of this checkout have.

After a change of ``msg_defs``, of one's own or pulled, an older build lacks fields, which shows late and in odd ways.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from pga_me_ros.dependencies import OWN_MESSAGES, outdated

DEFINITIONS = Path(__file__).resolve().parents[2] / "msg_defs"
"""The definitions in a checkout; an installation of this package alone has none."""

_NAME = re.compile(r"^[\w/]+(?:\[[^\]]*\])? +(\w+)", re.MULTILINE)
"""A field or a constant of a definition: its type, then its name."""


def require_same_messages() -> None:
    """Make sure that a build of pga_me_msgs, if there is one, has what this checkout defines, if this is a checkout.

    Raises:
        MissingDependencyError: It lacks a message, a service, a field or a constant.
    """
    spec = find_spec(OWN_MESSAGES)
    if spec is None or spec.origin is None or not _is_ours():
        return
    build = Path(spec.origin).parent
    for path in sorted([*DEFINITIONS.glob("msg/*.msg"), *DEFINITIONS.glob("srv/*.srv")]):
        for lacking in _lacking(path, build):
            raise outdated(OWN_MESSAGES, build, f"it lacks {lacking} of {path}")


def _is_ours() -> bool:
    package = DEFINITIONS / "package.xml"
    return package.is_file() and f"<name>{OWN_MESSAGES}</name>" in package.read_text()


def _lacking(definition: Path, build: Path) -> Iterator[str]:
    """Yield what the Python code made of a definition does not have; it is only read, as importing all takes longer."""
    snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", definition.stem).lower()
    made = build / definition.parent.name / f"_{snake}.py"
    if not made.is_file():
        yield definition.stem
        return
    code = made.read_text()
    for name in _NAME.findall(definition.read_text()):
        if f"'{name}'" not in code:
            yield f"'{name}'"
