"""Check for a display before a window is opened: without one, PyBullet exits the process."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys

from pga_me_ros.errors import SettingsError


def require_display() -> None:
    """Check that there is a display.

    Raises:
        SettingsError: There is no display, or it cannot be opened.
    """
    if not sys.platform.startswith("linux"):
        return
    name = os.environ.get("DISPLAY", "")
    if not name:
        raise SettingsError(
            "There is no display for a window (DISPLAY is not set); leave gui out and watch the robot in RViz or "
            "Foxglove, or render it to a file with `ros2 run pga_me_ros render`."
        )
    if not _answers():
        raise SettingsError(
            f"Display '{name}' cannot be opened for a window; set DISPLAY to one that you may use, or leave gui out."
        )


def _answers() -> bool:
    """Whether the display can be opened; true if we cannot tell."""
    library = ctypes.util.find_library("X11")
    if library is None:
        return True
    x11 = ctypes.CDLL(library)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = x11.XOpenDisplay(None)
    if display:
        x11.XCloseDisplay(ctypes.c_void_p(display))
    return bool(display)
