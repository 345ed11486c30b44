"""Which field of which message is which entry of the observation, and which joint gets which action."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pga_me_ros.client import Controller
from pga_me_ros.errors import SettingsError, nearest_name

RELATIVE = "-1 "
"""Beginning of the unit of an entry that is -1 at the lower limit of a joint and +1 at the upper one."""


@dataclass(frozen=True)
class Source:
    """A topic with sensor readings.

    Attributes:
        topic: Its name.
        type: Type of its messages, one of `fields.TYPES`.
        reliable: Whether every message must arrive; otherwise the newest counts, as usual for sensors.
        timeout: Age from which on its readings are stale, s; None for the controller's parameter.
    """

    topic: str
    type: str
    reliable: bool
    timeout: float | None


@dataclass(frozen=True)
class Entry:
    """Where an entry of the observation comes from: function(scale * field + offset), or a constant.

    With `limits`, it is -1 where scale * field + offset is at the lower one, and +1 at the upper one.

    Attributes:
        source: Name of its source, empty for a constant.
        part: Joint of a JointState, index of an array as text, else empty.
        field: Field of the message.
        scale: Factor.
        offset: Added to the product; of a constant, its value.
        function: ``sin``, ``cos`` or empty.
        limits: Lower and upper limit, None for none.
        delay: Control periods by which it is delayed.
    """

    source: str
    part: str
    field: str
    scale: float
    offset: float
    function: str
    limits: tuple[float, float] | None
    delay: int


@dataclass(frozen=True)
class Joint:
    """How an action becomes a command: scale * action + offset, within limits.

    Attributes:
        name: Name of the joint, in the joint states.
        action: Name of the action's entry.
        scale: Command per unit of the action, N·m or rad.
        offset: Command at an action of 0.
        low: Least command.
        high: Greatest command.
        rate: Greatest change of the command per second.
    """

    name: str
    action: str
    scale: float
    offset: float
    low: float
    high: float
    rate: float


@dataclass(frozen=True)
class RobotMapping:
    """What a mapping file says.

    Attributes:
        path: The file.
        task: Task whose robot it describes.
        sources: Topics by name.
        observation: Entries by name.
        topic: Topic of the commands.
        positions: Whether commands are positions, rad or m; otherwise efforts, N·m or N.
        joints: Joints in the order of the command.
    """

    path: Path
    task: str
    sources: Mapping[str, Source]
    observation: Mapping[str, Entry]
    topic: str
    positions: bool
    joints: tuple[Joint, ...]

    def require_fits(self, controller: Controller) -> None:
        """Check that this is the mapping of a controller's robot, with each entry and action exactly once.

        Raises:
            SettingsError: It is not.
        """
        if self.task != controller.task:
            raise SettingsError(
                f"Mapping '{self.path}' is for task '{self.task}', but the behavior is one of '{controller.task}'; "
                "give the mapping of that robot."
            )
        pairs = (
            ("observation", "entries", list(self.observation), controller.observation_names),
            ("commands", "actions", [j.action for j in self.joints], controller.action_names),
        )
        for section, what, given, known in pairs:
            self._require_same(section, what, given, known)
        self._require_limits(controller)

    def _require_limits(self, controller: Controller) -> None:
        """Check the limits of joints whose position is observed in shares of its range."""
        lows, highs = controller.joint_low.tolist(), controller.joint_high.tolist()
        known = dict(zip(controller.joint_names, zip(lows, highs, strict=True), strict=True))
        units = zip(controller.observation_names, controller.observation_units, strict=True)
        for name, unit in units:
            entry, limits = self.observation[name], known.get(name.removesuffix("/position"))
            relative = unit.startswith(RELATIVE) or (limits and name.endswith("/position"))
            if not relative or not entry.source:
                continue
            if entry.limits is None:
                raise SettingsError(
                    f"Mapping '{self.path}': observation {name} is in the unit '{unit}'; give low and high"
                    + (f", {limits[0]:.6g} and {limits[1]:.6g}." if limits else ".")
                )
            if limits and not np.allclose(entry.limits, limits, rtol=0.0, atol=1e-4):
                raise SettingsError(
                    f"Mapping '{self.path}': observation {name} has the limits {entry.limits[0]:g} and "
                    f"{entry.limits[1]:g}, but the behavior was grown with {limits[0]:.6g} and {limits[1]:.6g}; give "
                    "those, and scale and offset where the robot counts otherwise."
                )

    def _require_same(
        self, section: str, what: str, given: Sequence[str], known: Sequence[str]
    ) -> None:
        begin = f"Mapping '{self.path}': {section}"
        for name in given:
            if name not in known:
                raise SettingsError(
                    f"{begin} has '{name}'{nearest_name(name, known)}, but the controller's {what} are "
                    f"{', '.join(known)}."
                )
        missing = [name for name in known if name not in given]
        if missing:
            raise SettingsError(f"{begin} lacks {', '.join(missing)}; the controller needs all.")
        twice = sorted({name for name in given if list(given).count(name) > 1})
        if twice:
            raise SettingsError(
                f"{begin} uses {', '.join(twice)} for two joints; give each its own."
            )
