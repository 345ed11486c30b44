"""Controllers of an existing repertoire with which a run starts."""

from __future__ import annotations

import hashlib

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.settings import Settings

Controllers = Float32Array


def identity(controllers: Controllers) -> str:
    """Return what a run stores as ``start_from``: ``sha256:`` and a digest, or an empty string for no controllers."""
    if not len(controllers):
        return ""
    content = np.ascontiguousarray(controllers, "<f4")
    return f"sha256:{hashlib.sha256(str(content.shape).encode() + content.tobytes()).hexdigest()}"


def starting_with(settings: Settings, controllers: Controllers) -> Settings:
    """Return the settings of a run that starts with given controllers.

    They count among its `random_init` first controllers; `random_init` is raised if there are more.
    """
    count = max(settings.random_init, len(controllers))
    return settings.replace(start_from=identity(controllers), random_init=count)
