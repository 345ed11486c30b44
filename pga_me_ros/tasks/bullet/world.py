"""A PyBullet world with a floor and one robot, built as PyBullet's own environments build it."""

from __future__ import annotations

import os

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.bullet.robots import CONTROL_PERIOD, Robot

TORSO = "torso"

FLOOR_FRICTION = 0.8
"""Lateral friction of the floor."""

GRAVITY = -9.8
"""Gravity along z, m/s²."""


class World:
    """A physics client with the floor, the robot, and the saved state that every episode starts from.

    Attributes:
        client: Id of the physics client.
        floor: Body id of the floor.
        floor_friction: Its lateral friction.
        robot: Body id of the robot.
        joint_count: Number of joints, fixed ones included.
        joints: Indices of the actuated joints, ascending.
        joint_limits: Lower and upper limit of each actuated joint, rad.
        links: Link index by name.
        torso: Link index of the torso, -1 where it is the base.
        model_path: File that the robot was loaded from.

    Args:
        robot: Constants of the robot.
        render: Whether to open PyBullet's window.

    Raises:
        TaskError: The model in pybullet_data is missing or has other joints than the task
            describes.
    """

    def __init__(self, robot: Robot, *, render: bool = False) -> None:
        """Connect, load, and save the state that episodes start from."""
        import pybullet
        import pybullet_data

        self._pybullet = pybullet
        self.client: int = pybullet.connect(pybullet.GUI if render else pybullet.DIRECT)
        if self.client < 0:
            raise TaskError(
                "PyBullet could not open a world; without a display, leave `render` off"
            )
        try:
            self._set_physics()
            self.floor = self._load_floor(pybullet_data.getDataPath())
            self.robot = self._load_robot(pybullet_data.getDataPath(), robot.model)
            self._read_model(robot)
            self._release_motors()
            self._start: int = pybullet.saveState(physicsClientId=self.client)
        except BaseException:
            self.close()
            raise

    def begin_episode(self, positions: list[float]) -> None:
        """Reset the robot to its initial pose, at rest, independent of what happened before.

        Args:
            positions: Position of each actuated joint, rad.
        """
        pybullet, client, robot = self._pybullet, self.client, self.robot
        pybullet.restoreState(self._start, physicsClientId=client)
        # restoreState leaves the last episode's contact points in the engine's caches, and some would still push in the
        # first steps. In the restored pose nothing touches, so detecting collisions there removes them all.
        pybullet.performCollisionDetection(client)
        for joint, position in zip(self.joints, positions, strict=True):
            pybullet.resetJointState(robot, joint, position, 0.0, client)

    def pose(self, positions: list[float]) -> None:
        """Set the positions of all joints, passive ones included; for display, not for episodes.

        Args:
            positions: Position of each of `joint_count` joints, rad or m.
        """
        for joint, position in enumerate(positions):
            self._pybullet.resetJointState(self.robot, joint, position, 0.0, self.client)

    def place(self, link: int) -> tuple[float, float]:
        """Return x and y of a link's center of mass, m; -1 is the base."""
        pybullet = self._pybullet
        if link < 0:
            x, y, _ = pybullet.getBasePositionAndOrientation(self.robot, self.client)[0]
        else:
            x, y, _ = pybullet.getLinkState(self.robot, link, 0, 1, self.client)[0]
        return x, y

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        if self.client >= 0:
            self._pybullet.disconnect(self.client)
            self.client = -1

    def _set_physics(self) -> None:
        pybullet, client = self._pybullet, self.client
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
        pybullet.setGravity(0, 0, GRAVITY, physicsClientId=client)
        pybullet.setDefaultContactERP(0.9, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=CONTROL_PERIOD,
            numSolverIterations=5,
            numSubSteps=4,
            physicsClientId=client,
        )

    def _load_floor(self, folder: str) -> int:
        path = os.path.join(folder, "plane_stadium.sdf")
        try:
            (floor,) = self._pybullet.loadSDF(path, physicsClientId=self.client)
        except self._pybullet.error as error:
            raise TaskError(f"PyBullet cannot load {path} ({error}); reinstall pybullet") from error
        self.floor_friction = FLOOR_FRICTION
        self._pybullet.changeDynamics(
            floor,
            -1,
            lateralFriction=self.floor_friction,
            restitution=0.5,
            physicsClientId=self.client,
        )
        return int(floor)

    def _load_robot(self, folder: str, model: str) -> int:
        pybullet = self._pybullet
        path = self.model_path = os.path.join(folder, "mjcf", model)
        flags = (
            pybullet.URDF_USE_SELF_COLLISION
            | pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS
            | pybullet.URDF_GOOGLEY_UNDEFINED_COLORS
        )
        try:
            (robot,) = pybullet.loadMJCF(path, flags=flags, physicsClientId=self.client)
        except pybullet.error as error:
            raise TaskError(f"PyBullet cannot load {path} ({error}); reinstall pybullet") from error
        return int(robot)

    def _read_model(self, robot: Robot) -> None:
        self.links: dict[str, int] = {}
        self.joints: list[int] = []
        self.joint_limits: list[tuple[float, float]] = []
        names = []
        self.joint_count: int = self._pybullet.getNumJoints(self.robot, self.client)
        for index in range(self.joint_count):
            info = self._pybullet.getJointInfo(self.robot, index, self.client)
            name, lower, upper = info[1].decode(), info[8], info[9]
            self.links[info[12].decode()] = index
            # The model's names for joints that let the robot move in the plane, and for welds.
            if not name.startswith(("ignore", "jointfix")):
                names.append(name)
                self.joints.append(index)
                self.joint_limits.append((lower, upper))
        if names != list(robot.torques):
            raise TaskError(
                f"{robot.model} in pybullet_data has the joints {names}, "
                f"expected {list(robot.torques)}; install the pybullet version that is pinned"
            )
        self.torso = -1 if robot.torso_is_base else self.links[TORSO]

    def _release_motors(self) -> None:
        """Disable the motors that PyBullet gives every joint; the tasks apply torques instead."""
        for index in range(self.joint_count):
            self._pybullet.setJointMotorControl2(
                self.robot,
                index,
                self._pybullet.POSITION_CONTROL,
                targetPosition=0,
                targetVelocity=0,
                positionGain=0.1,
                velocityGain=0.1,
                force=0,
                physicsClientId=self.client,
            )
