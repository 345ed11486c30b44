"""Shapes of a task's controllers and critics."""

from __future__ import annotations

from typing import Protocol

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.settings import Settings


class RobotDimensions(Protocol):
    """What a network needs to know about a task; every task's spec provides it."""

    @property
    def observation_dim(self) -> int:
        """Numbers per observation."""

    @property
    def action_dim(self) -> int:
        """Numbers per action."""


def controller_shape(spec: RobotDimensions, settings: Settings) -> MlpShape:
    """Return the shape of a task's controllers: observation, `controller_hidden`, action."""
    return MlpShape((spec.observation_dim, *settings.controller_hidden, spec.action_dim))


def critic_shape(spec: RobotDimensions, settings: Settings) -> MlpShape:
    """Return the shape of a task's critics: observation with action, `critic_hidden`, value."""
    return MlpShape((spec.observation_dim + spec.action_dim, *settings.critic_hidden, 1))
