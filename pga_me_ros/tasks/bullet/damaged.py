"""Damage to the PyBullet robots and their floor, applied once to a newly opened world."""

from __future__ import annotations

import math

from pga_me_ros.tasks.bullet.robots import Robot
from pga_me_ros.tasks.bullet.world import FLOOR_FRICTION, GRAVITY, World
from pga_me_ros.tasks.damage import DamageError, Fault, check_parts, read_damage

HOLDING = 1e4
"""Greatest torque that holds a stuck joint, N·m; more changes nothing."""

REMAINS = 1e-3
"""Share of its mass that a missing part keeps: the engine needs some mass, and so little has no effect on the torso."""


class Damaged:
    """Damage to a robot and its world.

    Args:
        text: As in `damage.read_damage`; empty for no damage.
        name: Name of the task, for messages.
        robot: The robot.

    Attributes:
        torques: Torque of each motor at an action of 1, N·m, in joint order.

    Raises:
        DamageError: As in `damage.read_damage` and `damage.check_parts`.
    """

    def __init__(self, text: str, name: str, robot: Robot) -> None:
        """Read and check the text."""
        self._name = name
        self._faults = read_damage(text)
        check_parts(name, self._faults, robot.torques, robot.contact_links)
        shares = {fault.part: self._share(fault) for fault in self._faults if fault.part}
        self.torques = tuple(
            torque * shares[joint] if joint in shares else torque
            for joint, torque in robot.torques.items()
        )
        self._motors = list(robot.torques)
        self._stuck: dict[int, float] = {}

    def enter(self, world: World) -> None:
        """Damage a newly opened world.

        Raises:
            DamageError: The angle of a stuck joint is beyond its limits.
        """
        import pybullet

        self._pybullet, self._world = pybullet, world
        self._stuck = {}
        for fault in self._faults:
            if fault.kind == "jam":
                self._hold(fault.part, self._angle(fault))
            elif fault.kind == "gone":
                self._remove(fault.part)
            elif fault.kind == "slippery":
                link = world.links[fault.part]
                own = pybullet.getDynamicsInfo(world.robot, link, world.client)[1]
                self._change(world.robot, link, lateralFriction=own * fault.value)
            elif fault.kind == "load":
                own = pybullet.getDynamicsInfo(world.robot, world.torso, world.client)[0]
                self._change(world.robot, world.torso, mass=own + fault.value)
            elif fault.kind == "slope":
                self._tilt(math.radians(fault.value))
            elif fault.kind == "ice":
                world.floor_friction = FLOOR_FRICTION * fault.value
                self._change(world.floor, -1, lateralFriction=world.floor_friction)

    def pose(self, positions: list[float]) -> list[float]:
        """Return initial positions of the joints, rad, given those of an undamaged robot."""
        for joint, angle in self._stuck.items():
            positions[joint] = angle
        return positions

    def _share(self, fault: Fault) -> float:
        """Return the share of its torque that a damaged joint keeps."""
        return fault.value if fault.kind == "weak" else 0.0

    def _angle(self, fault: Fault) -> float:
        """Return the angle, rad, at which a joint is stuck; by default the one nearest to 0 within its limits.

        Raises:
            DamageError: The angle is beyond the joint's limits.
        """
        lower, upper = self._world.joint_limits[self._motors.index(fault.part)]
        if fault.given and not lower <= fault.value <= upper:
            raise DamageError(
                f"damage jams {fault.part} at {fault.value:g} rad, but on {self._name} it turns from {lower:.3f} to "
                f"{upper:.3f}; give an angle between them"
            )
        return min(max(fault.value, lower), upper)

    def _hold(self, joint: str, angle: float) -> None:
        """Hold a joint at an angle, rad."""
        world, pybullet = self._world, self._pybullet
        motor = self._motors.index(joint)
        self._stuck[motor] = angle
        pybullet.setJointMotorControl2(
            world.robot,
            world.joints[motor],
            pybullet.POSITION_CONTROL,
            targetPosition=angle,
            targetVelocity=0.0,
            positionGain=1.0,
            velocityGain=1.0,
            force=HOLDING,
            physicsClientId=world.client,
        )

    def _remove(self, joint: str) -> None:
        """Remove a joint and all links below it: almost no mass, no contacts, invisible."""
        world, pybullet = self._world, self._pybullet
        below = {world.joints[self._motors.index(joint)]}
        for index in range(world.joint_count):
            info = pybullet.getJointInfo(world.robot, index, world.client)
            if info[16] in below:
                below.add(index)
        for index in sorted(below):
            mass, _, inertia = pybullet.getDynamicsInfo(world.robot, index, world.client)[:3]
            if mass > 0.0:
                rest = [REMAINS * moment for moment in inertia]
                self._change(world.robot, index, mass=REMAINS * mass, localInertiaDiagonal=rest)
            pybullet.setCollisionFilterGroupMask(
                world.robot, index, 0, 0, physicsClientId=world.client
            )
            for shape in pybullet.getVisualShapeData(world.robot, index, world.client):
                if shape[1] == index:
                    pybullet.changeVisualShape(
                        world.robot, index, rgbaColor=(0, 0, 0, 0), physicsClientId=world.client
                    )
        for motor, index in enumerate(world.joints):
            if index in below:  # keep the remains from swinging about
                lower, upper = world.joint_limits[motor]
                self._hold(self._motors[motor], min(max(0.0, lower), upper))

    def _tilt(self, angle: float) -> None:
        """Tilt gravity instead of the floor; rails and height stay relative to the level floor."""
        x, z = GRAVITY * math.sin(angle), GRAVITY * math.cos(angle)
        self._pybullet.setGravity(x, 0.0, z, physicsClientId=self._world.client)

    def _change(self, body: int, link: int, **what: object) -> None:
        self._pybullet.changeDynamics(body, link, physicsClientId=self._world.client, **what)
