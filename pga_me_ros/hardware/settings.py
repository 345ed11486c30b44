"""Parameters of the controller, besides the choice of the behavior."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.field import setting


@dataclass(frozen=True)
class HardwareSettings:
    """How a behavior is run on joints."""

    mapping: str = setting(
        "",
        "YAML file that says which message is which entry of the observation, and which joint gets which action.",
        path=True,
    )
    repertoire: str = setting(
        "",
        "Repertoire to take the behavior from by a private archive manager: zoo/NAME or the folder of a run; empty to "
        "ask the node that serves one.",
        path=True,
    )
    trigger: str = setting(
        "",
        "Source of the mapping whose messages are answered by a command each; empty for a clock that gives one every "
        "control period.",
    )
    simulated: bool = setting(
        False,
        "Whether the robot is a simulation, which may be faster than real time. A real one gets one command per "
        "control period, however often the trigger comes.",
    )
    ramp: float = setting(
        1.0,
        "Time in which commands blend from rest to what the behavior wants, first and after each stop or freeze.",
        low=0.0,
        high=600.0,
        unit="s",
    )
    timeout: float = setting(
        0.1,
        "Age from which on a sensor reading is stale, so that the commands freeze; a source of the mapping may have "
        "its own.",
        low=0.001,
        high=600.0,
        unit="s",
    )
    frozen: str = setting(
        "zero",
        "Efforts while frozen: 'zero', or 'hold' the last ones. Positions are always held.",
        choices=("zero", "hold"),
    )
    resume: bool = setting(
        False,
        "Whether the commands ramp in again by themselves once stale sensors are back; otherwise they stay frozen "
        "until emergency_stop is called with data: false.",
    )
