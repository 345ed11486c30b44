"""A check that the requested ROS middleware is installed; rclpy would end the process without a clear message."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from pga_me_ros.dependencies import EXIT_BAD_INPUT
from pga_me_ros.paths import install_prefixes

ASKED_BY = ("RMW_IMPLEMENTATION", "RCL_ASSERT_RMW_ID_MATCHES")
INDEX = Path("share", "ament_index", "resource_index", "rmw_typesupport")
"""Folder of a prefix with one file per installed middleware."""

CHOOSER = "rmw_implementation"
"""Package in the index that is not a middleware itself: it loads the requested one."""


def require_middleware() -> None:
    """End this process with one line if its environment requests a middleware that is not installed.

    To be called before rclpy is imported: its library ends the process with status 102 and a line of its source code.
    """
    if "rclpy" in sys.modules:
        return
    installed = _installed()
    for variable in ASKED_BY:
        asked = os.environ.get(variable)
        if asked and installed and asked not in installed:
            print(
                f"error: {variable} is '{asked}', but the ROS 2 middleware installed here is "
                f"{', '.join(sorted(installed))}; unset the variable, or install that one.",
                file=sys.stderr,
                flush=True,
            )
            sys.exit(EXIT_BAD_INPUT)


def _installed() -> set[str]:
    """Return the names of the middlewares in the ament index; empty if there is no index."""
    folders = [prefix / INDEX for prefix in install_prefixes()]
    return {f.name for folder in folders if folder.is_dir() for f in folder.iterdir()} - {CHOOSER}
