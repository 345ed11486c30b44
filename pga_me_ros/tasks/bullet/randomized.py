"""Domain randomization of the PyBullet robots: drawn at each reset, applied through the episode."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.tasks.bullet.robots import CONTROL_PERIOD
from pga_me_ros.tasks.bullet.world import World
from pga_me_ros.tasks.randomization import read_ranges

PUSH_EVERY = round(1.0 / CONTROL_PERIOD)
"""Control steps from the start of one push to the next: one second."""

PUSH_FOR = round(0.1 / CONTROL_PERIOD)
"""Control steps that a push lasts: a tenth of a second."""


class Randomized:
    """Domain randomization of a robot and its world.

    All values are drawn from the episode's generator, after the initial pose: first those that hold for the whole
    episode, in the order of `randomization.KINDS`, then, step by step, the noise on observations.

    Args:
        text: As in `randomization.read_ranges`; empty for nothing.
        planar: Whether the robot moves only in a plane; it is then pushed only within it.

    Attributes:
        active: Whether anything is randomized.

    Raises:
        RandomizationError: As in `randomization.read_ranges`.
    """

    def __init__(self, text: str, *, planar: bool) -> None:
        """Read the ranges."""
        self._ranges = read_ranges(text)
        self.active = bool(self._ranges)
        self._planar = planar
        self._torques: Float64Array | None = None
        self._waiting: deque[list[float]] = deque()
        self._delay = 0
        self._sigma = 0.0
        self._pushes: list[tuple[float, float]] = []
        self._phase = self._step = 0

    def enter(self, world: World) -> None:
        """Attach to a newly opened world, and take its present masses as the nominal ones."""
        import pybullet

        self._pybullet = pybullet
        self._world = world
        links = range(-1, world.joint_count)
        infos = [
            (link, pybullet.getDynamicsInfo(world.robot, link, world.client)) for link in links
        ]
        self._masses = [(link, info[0], info[2]) for link, info in infos if info[0] > 0.0]

    def begin_episode(self, rng: np.random.Generator, joints: int, steps: int) -> None:
        """Draw the values of an episode and apply them to the world.

        Args:
            rng: Generator of the episode; the steps draw their noise from it, too.
            joints: Number of motors.
            steps: Greatest number of steps of the episode.
        """
        self._rng = rng
        self._step = 0
        if "mass" in self._ranges:
            self._change_masses(rng.uniform(*self._ranges["mass"], len(self._masses)))
        if "friction" in self._ranges:
            factor = rng.uniform(*self._ranges["friction"])
            world = self._world
            self._pybullet.changeDynamics(
                world.floor,
                -1,
                lateralFriction=world.floor_friction * factor,
                physicsClientId=world.client,
            )
        if "torque" in self._ranges:
            self._torques = rng.uniform(*self._ranges["torque"], joints)
        if "delay" in self._ranges:
            low, high = self._ranges["delay"]
            self._delay = int(rng.integers(int(low), int(high), endpoint=True))
            self._waiting = deque([[0.0] * joints for _ in range(self._delay)])
        if "noise" in self._ranges:
            self._sigma = float(rng.uniform(*self._ranges["noise"]))
        if "push" in self._ranges:
            self._draw_pushes(rng, steps)

    def delayed(self, commands: list[float]) -> list[float]:
        """Return the action that takes effect in this step, given the one commanded now."""
        if not self._delay:
            return commands
        self._waiting.append(commands)
        return self._waiting.popleft()

    def torques(self, torques: list[float]) -> list[float]:
        """Return the randomized torques of the motors, given the nominal ones."""
        if self._torques is None:
            return torques
        return [t * factor for t, factor in zip(torques, self._torques.tolist(), strict=True)]

    def push(self) -> None:
        """Push the robot if a push is due; call this right before each simulation step."""
        if not self._pushes:
            return
        which, since = divmod(self._step - self._phase, PUSH_EVERY)
        self._step += 1
        if which < 0 or since >= PUSH_FOR or which >= len(self._pushes):
            return
        world = self._world
        x, y = self._pushes[which]
        self._pybullet.applyExternalForce(
            world.robot,
            world.torso,
            [x, y, 0.0],
            list(self._torso_place()),
            self._pybullet.WORLD_FRAME,
            physicsClientId=world.client,
        )

    def sensed(self, observation: Float32Array, entries: int) -> Float32Array:
        """Add noise to the first entries of an observation in place and return it; the others are contact flags."""
        if self._sigma:
            noise = self._rng.standard_normal(entries, np.float32)
            observation[:entries] += noise * np.float32(self._sigma)
        return observation

    def _torso_place(self) -> Any:
        """Return the position of the torso's center of mass, m."""
        world = self._world
        if world.torso < 0:
            return self._pybullet.getBasePositionAndOrientation(world.robot, world.client)[0]
        return self._pybullet.getLinkState(world.robot, world.torso, 0, 1, world.client)[0]

    def _change_masses(self, factors: Float64Array) -> None:
        """Set masses and inertias of the links that have mass to multiples of the nominal ones."""
        world = self._world
        for (link, mass, inertia), factor in zip(self._masses, factors.tolist(), strict=True):
            self._pybullet.changeDynamics(
                world.robot,
                link,
                mass=mass * factor,
                localInertiaDiagonal=[x * factor for x in inertia],
                physicsClientId=world.client,
            )

    def _draw_pushes(self, rng: np.random.Generator, steps: int) -> None:
        """Draw the step of the first push, and the force of each push along x and y, N."""
        count = math.ceil(steps / PUSH_EVERY) + 1
        self._phase = int(rng.integers(PUSH_EVERY))
        forces = rng.uniform(*self._ranges["push"], count)
        angles = rng.uniform(0.0, 2.0 * math.pi, count)
        self._pushes = []
        for force, angle in zip(forces.tolist(), angles.tolist(), strict=True):
            x, y = math.cos(angle), math.sin(angle)
            if self._planar:  # it can only move forward or backward
                x, y = math.copysign(1.0, x), 0.0
            self._pushes.append((force * x, force * y))
