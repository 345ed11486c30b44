"""The guard between a controller and the joints: what it passes on is finite, ramped in, limited and never too fast.

It knows neither ROS nor clocks. It is told once per control period what the controller wants, or that nothing is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from pga_me_ros.arrays import Float64Array


class State(StrEnum):
    """What the guard is doing."""

    WAITING = "waiting for sensors"
    RAMPING = "ramping in"
    RUNNING = "running"
    FROZEN = "frozen"
    STOPPED = "stopped"


@dataclass(frozen=True, eq=False)
class Limits:
    """What each of n joints may be commanded.

    Attributes:
        low: (n,) float64 least command, N·m or rad.
        high: (n,) float64 greatest command.
        step: (n,) float64 greatest change from one command to the next; above 0.
    """

    low: Float64Array
    high: Float64Array
    step: Float64Array


class Guard:
    """Turns what a controller wants into what the joints get.

    Of the first three rules, the first that applies decides alone; otherwise the last three follow in turn.

    1. Stopped: efforts are 0; positions stay where they were last commanded. Only `release` ends it.
    2. A wanted command that is not finite stops.
    3. A sensor is missing or stale, so that nothing is known: before the first command, none is given; later ones
       freeze: efforts are 0, or held if so chosen; positions are held. It lasts until a `release` while all is known,
       or, if so chosen, until all is known again.
    4. Otherwise the command blends from rest to what is wanted, within the ramp's time; after a stop or a freeze, too.
       Efforts that were held are the rest that they blend from.
    5. It is clipped to the limits.
    6. It differs from the last command, or from where a ramp begins, by no more than a step.

    Args:
        limits: Limits of the joints.
        ramp_steps: Commands until what is wanted counts in full, 0 for at once.
        positions: Whether commands are positions; otherwise efforts.
        hold: Whether efforts are held rather than 0 while frozen.
        resume: Whether a freeze ends by itself.

    Attributes:
        state: What it is doing.
        reason: Why it is frozen or stopped, else empty.
    """

    def __init__(
        self, limits: Limits, *, ramp_steps: int, positions: bool, hold: bool, resume: bool
    ) -> None:
        self._limits = limits
        self._ramp_steps = ramp_steps
        self._positions = positions
        self._hold = hold
        self._resume = resume
        self._zero = np.zeros(len(limits.low))
        self._rest = self._zero
        self._last: Float64Array | None = None
        self._ramped = 0
        self.state = State.WAITING
        self.reason = ""

    @property
    def has_commanded(self) -> bool:
        """Whether any command was returned, so that the joints have one to follow."""
        return self._last is not None

    def command(
        self, wanted: Float64Array, rest: Float64Array | None = None
    ) -> Float64Array | None:
        """Return the next command, given what the controller wants.

        Args:
            wanted: (n,) float64 wanted command.
            rest: (n,) float64 command that leaves the robot as it is: the measured positions; None for efforts, which
                ramp in from the last ones: 0 unless they were held.

        Returns:
            (n,) float64 finite command; None if there is nothing to hold yet.
        """
        if rest is None:
            rest = self._zero if self._last is None else self._last
        if not (np.isfinite(wanted).all() and np.isfinite(rest).all()):
            self.stop("the controller's command is not finite")
        if self.state is State.STOPPED or (self.state is State.FROZEN and not self._resume):
            return self._safe()
        if self.state in (State.WAITING, State.FROZEN):
            self._rest, self._last, self._ramped = rest, rest, 0
            self.reason = ""
        self._ramped += 1
        if self._ramped < self._ramp_steps:
            self.state = State.RAMPING
            wanted = self._rest + self._ramped / self._ramp_steps * (wanted - self._rest)
        else:
            self.state = State.RUNNING
        limits, last = self._limits, self._last
        assert last is not None
        within = np.clip(wanted, limits.low, limits.high)
        self._last = np.clip(within, last - limits.step, last + limits.step)
        return self._last

    def freeze(self, reason: str) -> Float64Array | None:
        """Return the command for a moment at which what the controller wants is not known.

        Args:
            reason: Why it is not known.
        """
        if not self.has_commanded:
            return None
        if self.state not in (State.STOPPED, State.FROZEN):  # whose reasons are kept
            self.state, self.reason = State.FROZEN, reason
        return self._safe()

    def stop(self, reason: str) -> Float64Array | None:
        """Stop until `release`, and return the command to be given at once.

        Args:
            reason: Why; the first one is kept.
        """
        if self.state is not State.STOPPED:
            self.state, self.reason = State.STOPPED, reason
        return self._safe()

    def release(self) -> None:
        """End a stop or a freeze: what comes next is ramped in as at first, or is a freeze if a sensor is missing."""
        if self.state in (State.STOPPED, State.FROZEN):
            self.state, self.reason = State.WAITING, ""

    def _safe(self) -> Float64Array | None:
        if self._positions or (self._hold and self.state is State.FROZEN):
            return self._last
        self._last = self._zero
        return self._last


def ramp_steps(seconds: float, period: float) -> int:
    """Return the number of control periods that a ramp takes, rounded up."""
    return math.ceil(round(seconds / period, 6))
