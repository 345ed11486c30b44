"""The QD locomotion tasks of §4.1 (Nilsson & Cully 2021): run fast at little energy, with many gaits.

Observation, reward and termination equal those of PyBullet's own locomotion environments, bit for
bit. Each quantity is read from PyBullet once per step; the rest is arithmetic on plain floats,
which for so few numbers is several times faster than arrays.
"""

from __future__ import annotations

import math
from operator import itemgetter
from typing import ClassVar

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.tasks.body import Body
from pga_me_ros.tasks.bullet import robots
from pga_me_ros.tasks.bullet.coincidence import places_of
from pga_me_ros.tasks.bullet.damaged import Damaged
from pga_me_ros.tasks.bullet.heading import Heading, Vector
from pga_me_ros.tasks.bullet.motors import Motors
from pga_me_ros.tasks.bullet.randomized import Randomized
from pga_me_ros.tasks.bullet.robots import OBSERVATION_LIMIT, Robot, build_spec
from pga_me_ros.tasks.bullet.sums import Float32Means, threshold_after_rounding
from pga_me_ros.tasks.bullet.world import World
from pga_me_ros.tasks.spec import TaskSpec

ELECTRICITY_COST = -2.0
STALL_TORQUE_COST = -0.1
JOINT_AT_LIMIT_COST = -0.1

INITIAL_SPREAD = 0.1
"""Initial joint positions are uniform within this angle of 0, rad."""

_AT_LIMIT = threshold_after_rounding(0.99)
_JOINT_OFFSET = 8

Quaternion = tuple[float, float, float, float]


class LocomotionTask:
    """A robot that runs along x; `pga_me_ros.tasks.protocol.Task` documents the methods.

    Reward of a step: alive bonus (+1, else -1), plus the speed towards the target in m/s, minus
    2 mean(abs(0.1 joint speed * action)), minus 0.1 mean(action²), minus 0.1 per joint at a limit.
    The robot's position is the mean over its parts and the floor.

    Descriptor: share of the episode's steps after which each foot touched the floor; 0 before the
    first step.

    Args:
        render: Whether to open PyBullet's window.
        randomization: What varies from episode to episode, see `pga_me_ros.tasks.randomization`; empty for nothing.
        damage: Damage in all episodes, see `pga_me_ros.tasks.damage`; empty for none.

    Raises:
        DamageError: The text is invalid, or this robot has no such part.
        RandomizationError: The text is invalid.
        TaskError: PyBullet cannot open a world or load the robot.
    """

    spec: ClassVar[TaskSpec]
    robot: ClassVar[Robot]
    _diverged: bool
    _joints_at_limit: int

    def __init__(self, *, render: bool = False, randomization: str = "", damage: str = "") -> None:
        """Open a world and begin an episode, so that any method can be called right away."""
        import pybullet

        self._pybullet = pybullet
        self._render = render
        self.randomization = randomization
        self._randomized = Randomized(randomization, planar=not self.robot.torso_is_base)
        self.damage = damage
        self._damaged = Damaged(damage, self.spec.name, self.robot)
        self._motor_count = len(self.robot.torques)
        self._torques = Motors(self.spec.name, self._damaged.torques)
        contacts = self.robot.contact_links
        self._feet = tuple(contacts.index(foot) for foot in self.robot.feet)
        self._bruising = tuple(contacts.index(link) for link in self.robot.bruising_links)
        self._joint_end = _JOINT_OFFSET + 2 * self._motor_count
        self._heading = Heading()
        self._float32_means = Float32Means(self._motor_count)
        self._open_world()
        self.reset(np.random.Generator(np.random.PCG64(0)))

    def reset(self, rng: np.random.Generator) -> Float32Array:
        """Begin an episode: joints uniform in ±0.1 rad, at rest.

        Args:
            rng: Source of the joints' initial positions, drawn in joint order.

        Returns:
            (observation_dim,) float32 array.
        """
        if self._diverged:
            self.close()
            self._open_world()
        positions = rng.uniform(-INITIAL_SPREAD, INITIAL_SPREAD, self._motor_count)
        self._world.begin_episode(self._damaged.pose(positions.tolist()))
        if self._randomized.active:
            self._randomized.begin_episode(rng, self._motor_count, self.spec.max_steps)
        self._touching = [0.0] * len(self.robot.contact_links)
        self._contact_steps = [0.0] * len(self._feet)
        self._steps = 0
        self._initial_height = self._torso()[0][2]
        return _clip(self._sensed(np.array(self._measure(), np.float32)))

    def step(self, action: Float32Array) -> tuple[Float32Array, float, bool]:
        """Apply torques for one control period of 16.5 ms.

        Args:
            action: (action_dim,) float32 array; clipped to ±1 for the torques, but not for the cost
                of electricity.

        Returns:
            Observation, (observation_dim,) float32 within ±5; reward; whether the robot fell.

        Raises:
            TaskError: The action has the wrong length.
            NonFiniteActionError: The action contains NaN or infinity; nothing was simulated.
        """
        pybullet, world, randomized = self._pybullet, self._world, self._randomized
        commands = np.asarray(action, np.float32).tolist()
        torques = self._torques(commands)
        if randomized.active:
            commands = randomized.delayed(commands)
            torques = randomized.torques(self._torques(commands))
            randomized.push()
        pybullet.setJointMotorControlArray(
            world.robot,
            world.joints,
            pybullet.TORQUE_CONTROL,
            forces=torques,
            physicsClientId=world.client,
        )
        pybullet.stepSimulation(world.client)
        old_potential = self._potential
        observation = np.array(self._measure(), np.float32)
        rounded = observation.tolist()
        electricity = self._electricity(commands, rounded[_JOINT_OFFSET + 1 : self._joint_end : 2])
        if max(rounded) > OBSERVATION_LIMIT or min(rounded) < -OBSERVATION_LIMIT:
            rounded = _clip(observation).tolist()
        alive = self._is_alive(rounded[0])
        self._read_contacts()
        self._steps += 1
        reward = (1.0 if alive else -1.0) + (self._potential - old_potential)
        reward = reward + electricity + JOINT_AT_LIMIT_COST * self._joints_at_limit
        self._diverged = not math.isfinite(reward)
        if randomized.active:
            observation = _clip(self._sensed(observation))
        return observation, reward, self._diverged or (self.robot.can_fall and not alive)

    def descriptor(self) -> Float64Array:
        """Return each foot's share of the steps so far that ended with it on the floor.

        Returns:
            (descriptor_dim,) float64 array within [0, 1].
        """
        return np.array(self._contact_steps) / max(self._steps, 1)

    @classmethod
    def check_damage(cls, damage: str) -> None:
        """Check that a text describes damage that this robot can have, without a simulator.

        Raises:
            DamageError: The text is invalid, or this robot has no such part.
        """
        Damaged(damage, cls.spec.name, cls.robot)

    def contacts(self) -> tuple[bool, ...]:
        """Return whether each of ``robot.contact_links`` touches the floor after the last step."""
        return tuple(flag > 0.0 for flag in self._touching)

    def joint_states(self) -> tuple[list[float], list[float]]:
        """Return positions, rad, and velocities, rad/s, of the actuated joints in action order."""
        world = self._world
        states = self._pybullet.getJointStates(world.robot, world.joints, world.client)
        return [state[0] for state in states], [state[1] for state in states]

    @property
    def body(self) -> Body:
        """The robot in its world, for display; a new one after a simulation that diverged."""
        world = self._world
        return Body(world.client, world.robot, world.torso, world.model_path, self.robot.torques)

    def close(self) -> None:
        """Close the world; a second call does nothing."""
        self._world.close()

    def _open_world(self) -> None:
        world = self._world = World(self.robot, render=self._render)
        self._damaged.enter(world)
        self._joint_scales = [(lower, upper - lower) for lower, upper in world.joint_limits]
        self._contact_indices = [world.links[name] for name in self.robot.contact_links]
        # The mean position adds the torso second, as in the environments' list of parts.
        first, *others = (index for index in world.links.values() if index != world.torso)
        parts = [first, world.torso, *others]
        places = places_of(world, parts)
        # The torso's position is read anyway, with its velocity.
        self._read_links = sorted(set(places) - {world.torso})
        order = [world.torso, *self._read_links]
        self._pick_parts = itemgetter(*(order.index(place) for place in places))
        self._diverged = False
        if self._randomized.active:
            self._randomized.enter(world)

    def _sensed(self, observation: Float32Array) -> Float32Array:
        return self._randomized.sensed(observation, self._joint_end)

    def _measure(self) -> list[float]:
        """Read the world after a step.

        Also sets the potential, the pitch and the number of joints at a limit.
        """
        world, pybullet = self._world, self._pybullet
        joint_states = pybullet.getJointStates(world.robot, world.joints, world.client)
        position, orientation, velocity = self._torso()
        roll, pitch, yaw = pybullet.getEulerFromQuaternion(orientation)
        self._pitch = pitch
        xs, ys = self._part_positions(position)
        self._potential, (sine, cosine, forward, left, up) = self._heading(xs, ys, yaw, velocity)
        values = [position[2] - self._initial_height, sine, cosine]
        values += (0.3 * forward, 0.3 * left, 0.3 * up, roll, pitch)
        at_limit = 0
        for (lower, span), state in zip(self._joint_scales, joint_states, strict=True):
            scaled = 2 * (state[0] - lower) / span - 1.0
            if abs(scaled) > _AT_LIMIT:
                at_limit += 1
            values += (scaled, 0.1 * state[1])
        self._joints_at_limit = at_limit
        values += self._touching
        return values

    def _torso(self) -> tuple[Vector, Quaternion, Vector]:
        """Return the torso's position (m), orientation (x, y, z, w) and velocity (m/s)."""
        world, pybullet = self._world, self._pybullet
        if world.torso >= 0:
            state = pybullet.getLinkState(world.robot, world.torso, 1, 0, world.client)
            return state[0], state[1], state[6]
        position, orientation = pybullet.getBasePositionAndOrientation(world.robot, world.client)
        return position, orientation, pybullet.getBaseVelocity(world.robot, world.client)[0]

    def _part_positions(self, torso: Vector) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return x and y of the robot's parts, m, in the engine's order."""
        world = self._world
        links = self._pybullet.getLinkStates(world.robot, self._read_links, 0, 0, world.client)
        xs = [torso[0], *[link[0][0] for link in links]]
        ys = [torso[1], *[link[0][1] for link in links]]
        return self._pick_parts(xs), self._pick_parts(ys)

    def _electricity(self, commands: list[float], speeds: list[float]) -> float:
        """Return the cost of driving the motors; both means are in float32, as in PyBullet's environments.

        Args:
            commands: The action; float32 values, so that products in float64 are exact.
            speeds: 0.1 joint velocity, rad/s; float32 values.
        """
        power = [abs(command * speed) for command, speed in zip(commands, speeds, strict=True)]
        stall = [command * command for command in commands]
        try:
            power_mean, stall_mean = self._float32_means(power, stall)
        except OverflowError:  # beyond float32, where their means are infinite
            return -math.inf
        return ELECTRICITY_COST * power_mean + STALL_TORQUE_COST * stall_mean

    def _is_alive(self, rise: float) -> bool:
        """Whether the robot stands upright; contacts are those before this step.

        Args:
            rise: Observed height above the start, m.
        """
        robot = self.robot
        if robot.max_pitch is not None and not abs(self._pitch) < robot.max_pitch:
            return False
        if robot.min_height is not None:
            return rise + self._initial_height > robot.min_height
        return not any(self._touching[index] for index in self._bruising)

    def _read_contacts(self) -> None:
        world = self._world
        points = self._pybullet.getContactPoints(world.robot, world.floor, -2, -2, world.client)
        touching = {point[3] for point in points}
        flags = self._touching = [1.0 if i in touching else 0.0 for i in self._contact_indices]
        for foot, index in enumerate(self._feet):
            self._contact_steps[foot] += flags[index]


def _clip(observation: Float32Array) -> Float32Array:
    """Limit an observation to ±5 in place and return it."""
    return np.clip(observation, -OBSERVATION_LIMIT, OBSERVATION_LIMIT, out=observation)


class QDWalker(LocomotionTask):
    """A planar biped; the descriptor is (right foot, left foot)."""

    robot = robots.WALKER
    spec = build_spec("qd_walker", robots.WALKER, 1024, (32, 32))


class QDHalfCheetah(LocomotionTask):
    """A planar two-legged runner that cannot fall; the descriptor is (front foot, back foot)."""

    robot = robots.HALF_CHEETAH
    spec = build_spec("qd_half_cheetah", robots.HALF_CHEETAH, 1024, (32, 32))


class QDAnt(LocomotionTask):
    """A quadruped; the descriptor is (front left, front right, back left, back right foot)."""

    robot = robots.ANT
    spec = build_spec("qd_ant", robots.ANT, 1296, (6, 6, 6, 6))


class QDHopper(LocomotionTask):
    """A planar one-legged hopper; the descriptor is its foot."""

    robot = robots.HOPPER
    spec = build_spec("qd_hopper", robots.HOPPER, 1000, (1000,))
