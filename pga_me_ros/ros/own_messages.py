"""A check that pga_me_msgs was built from the definitions of this checkout.

After a change of ``msg_defs``, of one's own or pulled, an older build lacks fields, which shows late and in odd ways.
"""

from __future__ import annotations

from pathlib import Path

from pga_me_ros.dependencies import OWN_MESSAGES, outdated
from pga_me_ros.paths import install_prefixes

DEFINITIONS = Path(__file__).resolve().parents[2] / "msg_defs"
"""The definitions in a checkout; an installation of this package alone has none."""


def require_same_messages() -> None:
    """Make sure that the build of pga_me_msgs has this checkout's definitions, where there are a build and a checkout.

    Raises:
        MissingDependencyError: It has others.
    """
    built = _built()
    if built is None:
        return
    for path in sorted([*DEFINITIONS.glob("msg/*.msg"), *DEFINITIONS.glob("srv/*.srv")]):
        copy = built / path.relative_to(DEFINITIONS)
        if not copy.is_file() or copy.read_bytes() != path.read_bytes():
            raise outdated(OWN_MESSAGES, f"its {path.name} is not that of {DEFINITIONS}")


def _built() -> Path | None:
    """Return the folder in which the build keeps copies of its definitions; None if there is none."""
    folders = [prefix / "share" / OWN_MESSAGES for prefix in install_prefixes()]
    return next((folder for folder in folders if (folder / "package.xml").is_file()), None)
