"""Whether this machine's memory can hold the networks that a run's settings ask for."""

from __future__ import annotations

import os

from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import SettingsError
from pga_me_ros.tasks.spec import TaskSpec

NUMBER = 4
"""Bytes of a parameter, which is a float32."""

CRITIC_COPIES = 10
"""Times that a critic's parameters are held while it is trained: two critics, each with its target, gradient and two
moments of Adam."""


def require_memory(spec: TaskSpec, settings: Settings) -> None:
    """Refuse networks that cannot be held at least once as they are used, whatever else there is.

    Args:
        spec: Task.
        settings: Settings of the run.

    Raises:
        SettingsError: A generation of controllers, or the critics, are larger than the memory of this machine.
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
