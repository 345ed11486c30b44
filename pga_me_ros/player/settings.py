"""Parameters of the behavior player, besides the choice of the behavior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pga_me_ros.core.settings.field import INT64_MAX, setting
from pga_me_ros.errors import SettingsError


@dataclass(frozen=True)
class PlayerSettings:
    """How to play."""

    run_dir: str = setting(
        "",
        "Folder of a run, or its repertoire file, to take the gait from; empty to ask the node that serves one.",
        path=True,
    )
    episodes: int = setting(0, "Episodes to play; 0 plays until stopped.", low=0, high=INT64_MAX)
    start: str = setting(
        "evaluated",
        "Initial pose: 'evaluated' repeats the original evaluation bit for bit; 'fresh' is a new pose in each episode.",
        choices=("evaluated", "fresh"),
    )
    damage: str = setting(
        "",
        "Damage to the robot or its world, for example 'jam foot_joint 0.3, ice'; empty for none.",
    )
    speed: float = setting(
        1.0,
        "Simulated seconds per second; 0 plays as fast as the machine can.",
        low=0.0,
        high=1000.0,
        rate=True,
    )
    clock: bool = setting(
        True,
        "Whether to publish /clock and stamp messages with simulated time; otherwise stamps are system time.",
    )
    frame_prefix: str = setting(
        "", "Prefix of frame names, for several robots in one tf tree: left/."
    )
    commanded: str = setting(
        "none",
        "Whether the joints follow the efforts on the topic commands instead of the gait: 'lock_step' waits for a "
        "command before each step, 'real_time' takes the newest one.",
        choices=("none", "lock_step", "real_time"),
    )
    hold: float = setting(
        0.0,
        "How long the robot is held in its initial pose while it is commanded, counted from the first command: time to "
        "ramp in.",
        low=0.0,
        high=3600.0,
        unit="s",
    )
    gui: bool = setting(False, "Whether to open the simulator's window.")


def require_sense(values: Mapping[str, Any]) -> None:
    """Check that the parameters fit each other.

    Args:
        values: Parameters by name.

    Raises:
        SettingsError: They do not.
    """
    if values["commanded"] == "real_time" and not values["speed"]:
        raise SettingsError("commanded is 'real_time', but speed is 0; give a speed above 0.")
    if values["commanded"] == "none" and values["hold"]:
        raise SettingsError(
            f"hold is {values['hold']:g}, but the gait itself acts; give commanded:=lock_step or real_time."
        )
