"""Garbage collection is off while a node imports its libraries: they are no garbage, and looking at them takes time."""

from __future__ import annotations

import gc


def pause_collection() -> None:
    """Do not collect garbage until `resume_collection`."""
    gc.disable()


def resume_collection() -> None:
    """Collect garbage again, but never look at what there is already; no effect if it is not paused."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
