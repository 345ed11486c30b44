"""From sensor messages to a controller's observation."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.client import Controller
from pga_me_ros.errors import PgaError, nearest_name
from pga_me_ros.hardware.fields import ARRAY, FIELDS, JOINTS, UnusableError
from pga_me_ros.hardware.mapping import Entry, RobotMapping

PATIENCE = 20
"""Messages after which a joint that none of them named counts as wrong: robots may divide joints among messages."""

_FUNCTIONS = {"sin": math.sin, "cos": math.cos}


class SensorError(PgaError):
    """A message lacks what the mapping takes from it."""


class Channel(NamedTuple):
    """One number in the messages of a source; `part` and `field` as in `Entry`."""

    source: str
    part: str
    field: str


class Observer:
    """Keeps the newest readings, and makes observations of them.

    Times are seconds of any clock that never jumps. They are those of reception: the clocks of sensors may differ.

    Args:
        mapping: The mapping; it must fit the controller.
        controller: The controller.
    """

    def __init__(self, mapping: RobotMapping, controller: Controller) -> None:
        self._mapping = mapping
        self._entries = [mapping.observation[name] for name in controller.observation_names]
        self._low = controller.observation_low.astype(np.float32)
        self._high = controller.observation_high.astype(np.float32)
        self._delayed = {i: deque([0.0] * e.delay) for i, e in enumerate(self._entries) if e.delay}
        channels = {_channel(e): None for e in self._entries if e.source}
        self._joints: list[Channel] = []
        if mapping.positions:
            states = next(n for n, s in mapping.sources.items() if s.type == JOINTS)
            self._joints = [Channel(states, joint.name, "position") for joint in mapping.joints]
        self._channels = tuple({**channels, **dict.fromkeys(self._joints)})
        self._values: dict[Channel, float] = {}
        self._heard: dict[Channel, float] = {}
        self._unnamed: dict[Channel, int] = {}

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the sources that are in use."""
        return tuple(dict.fromkeys(channel.source for channel in self._channels))

    def take(self, source: str, msg: Any, now: float) -> None:
        """Take the readings of a message; all of them or, if it raises, none.

        Raises:
            SensorError: A joint, an entry of an array or a field is missing.
            UnusableError: A reading is NaN or infinite, or the message says that it is not known.
        """
        found: dict[Channel, float] = {}
        for channel in self._channels:
            if channel.source == source:
                value = self._read(channel, msg)
                if value is not None:
                    found[channel] = value
        for channel, value in found.items():
            if not math.isfinite(value):
                raise UnusableError(f"{self._words(channel)} is {value}; the message is not used.")
        self._values |= found
        self._heard |= dict.fromkeys(found, now)

    def missing(self, now: float, timeout: float) -> str:
        """Return which reading was never heard, or is the oldest of those beyond their timeouts, in words; or empty.

        Args:
            now: The present.
            timeout: Timeout of sources that have none of their own, s.
        """
        oldest, greatest = None, 0.0
        for channel in self._channels:
            own = self._mapping.sources[channel.source].timeout
            age = now - self._heard.get(channel, -math.inf)
            if age > (timeout if own is None else own) and age > greatest:
                oldest, greatest = channel, age
        if oldest is None:
            return ""
        age_in_words = "was never heard" if greatest == math.inf else f"is {greatest:.2f} s old"
        return f"{self._words(oldest)} {age_in_words}"

    def shortest_timeout(self, timeout: float) -> float:
        """Return the least age, s, at which one of the sources in use is stale; `timeout` as in `missing`."""
        own = (self._mapping.sources[source].timeout for source in self.sources)
        return min(timeout if seconds is None else seconds for seconds in own)

    def newest(self) -> float:
        """Return when the newest reading came."""
        return max(self._heard.values(), default=0.0)

    def observation(self) -> Float32Array:
        """Return the observation of this control period; to be called once in each, when nothing is `missing`.

        Returns:
            (observation_dim,) float32, limited as in the task.
        """
        values = [self._delay(i, self._value(entry)) for i, entry in enumerate(self._entries)]
        observation = np.array(values, np.float32)
        if len(self._low):
            np.clip(observation, self._low, self._high, out=observation)
        return observation

    def positions(self) -> Float64Array | None:
        """Return the (n,) measured positions of the commanded joints; None where efforts are commanded."""
        if not self._mapping.positions:
            return None
        return np.array([self._values[channel] for channel in self._joints])

    def _value(self, entry: Entry) -> float:
        value = entry.offset
        if entry.source:
            value += entry.scale * self._values[_channel(entry)]
        if entry.limits:
            low, high = entry.limits
            value = 2 * (value - low) / (high - low) - 1.0
        return _FUNCTIONS[entry.function](value) if entry.function else value

    def _delay(self, i: int, value: float) -> float:
        if i not in self._delayed:
            return value
        self._delayed[i].append(value)
        return self._delayed[i].popleft()

    def _read(self, channel: Channel, msg: Any) -> float | None:
        """Return a reading; None if the message is of other joints."""
        kind = self._mapping.sources[channel.source].type
        if kind == JOINTS:
            return self._of_joint(channel, msg)
        if kind == ARRAY:
            if int(channel.part) >= len(msg.data):
                raise SensorError(
                    f"{self._words(channel)} is missing: the message has {len(msg.data)} entries, counted from 0."
                )
            return float(msg.data[int(channel.part)])
        try:
            return float(FIELDS[kind][channel.field](msg))
        except UnusableError as error:
            raise UnusableError(
                f"{self._words(channel)} is not known, {error}; the message is not used."
            ) from None

    def _of_joint(self, channel: Channel, msg: Any) -> float | None:
        values = getattr(msg, channel.field)
        if channel.part in msg.name:
            place = msg.name.index(channel.part)
            if place < len(values):
                return float(values[place])
            raise SensorError(
                f"{self._words(channel)} is missing: the message has no {channel.field} of it."
            )
        if channel not in self._heard:
            count = self._unnamed[channel] = self._unnamed.get(channel, 0) + 1
            if count >= PATIENCE:
                near = nearest_name(channel.part, msg.name)
                raise SensorError(
                    f"Topic '{self._topic(channel)}' has no joint '{channel.part}'{near}; it has {', '.join(msg.name)}."
                )
        return None

    def _topic(self, channel: Channel) -> str:
        return self._mapping.sources[channel.source].topic

    def _words(self, channel: Channel) -> str:
        part = f" of {channel.part}" if channel.part else ""
        if self._mapping.sources[channel.source].type == ARRAY:
            part = f" {channel.part}"
        return f"{channel.field}{part} on topic '{self._topic(channel)}'"


def _channel(entry: Entry) -> Channel:
    return Channel(entry.source, entry.part, entry.field)
