"""Descriptors and environments of a user, as the tests name them."""

from __future__ import annotations

import gymnasium
import numpy as np


def reach(observations, actions):
    """Return the highest first entry, and the mean size of the actions."""
    effort = float(np.abs(actions).mean()) if len(actions) else 0.0
    return [float(observations[:, 0].max()), effort]


reach.low, reach.high, reach.names = [-1.0, 0.0], [1.0, 2.0], ["reach", "effort"]


def too_long(observations, actions):
    return [0.0, 0.0, 0.0]


too_long.low, too_long.high = [0.0, 0.0], [1.0, 1.0]


def without_bounds(observations, actions):
    return [0.0]


class LastAction:
    """The last action; a class that watches the episode."""

    names, low, high = ("last",), (-2.0,), (2.0,)

    def __init__(self, env):
        self.last = 0.0

    def begin(self, observation):
        self.last = 0.0

    def step(self, observation, action):
        self.last = float(action[0])

    def value(self):
        return [self.last]


class TruncatesEarly(gymnasium.Wrapper):
    """Ends an episode after three steps without termination."""

    def reset(self, **options):
        self.steps = 0
        return super().reset(**options)

    def step(self, action):
        self.steps += 1
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, self.steps >= 3, info


class Remembers(gymnasium.Wrapper):
    """Adds what it saw in earlier episodes to the reward: state that survives a reset."""

    total = 0.0

    def step(self, action):
        observation, reward, *rest = super().step(action)
        self.total += 0.001
        return observation, reward + self.total, *rest


class GivesNan(gymnasium.ObservationWrapper):
    def observation(self, observation):
        return observation * np.nan
