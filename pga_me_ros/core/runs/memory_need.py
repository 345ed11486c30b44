"""Whether this machine's memory can hold the networks of a run's settings."""

from __future__ import annotations

import os

from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import SettingsError
from pga_me_ros.tasks.spec import TaskSpec

NUMBER = 4
"""Bytes of a parameter, which is a float32."""

CRITIC_COPIES = 10
"""Arrays of a critic's size that training holds: two critics, each with target, gradient and two moments of Adam."""


def require_memory(spec: TaskSpec, settings: Settings) -> None:
    """Refuse networks that do not fit into memory even without anything else.

    Args:
        spec: Task.
        settings: Settings of the run.

    Raises:
        SettingsError: A generation of controllers, or the critics in training, are larger than this machine's memory.
    """
    available = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    controllers = controller_shape(spec, settings).parameter_count * settings.batch_size
    critics = critic_shape(spec, settings).parameter_count * CRITIC_COPIES
    for what, names, numbers in (
        ("a generation of controllers", "controller_hidden or batch_size", controllers),
        ("the critics", "critic_hidden", critics),
    ):
        if numbers * NUMBER > available:
            raise SettingsError(
                f"Memory of {numbers * NUMBER / 1e9:.0f} GB is needed for {what}, and this machine has "
                f"{available / 1e9:.0f} GB; give smaller {names}."
            )
