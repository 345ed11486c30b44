"""A robot model for ROS tools: links with shapes, joints between them, and link poses."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace
from itertools import chain, count

from pga_me_ros.player.transform import UNTURNED, ZERO, Transform, Vector, turn

BASE_LINK = "base_link"
"""Base frame of the robot: the torso's center of mass, with the torso's orientation."""

TORSO_CENTER = "torso_center"
"""Name of that frame if the robot already has a link named `BASE_LINK`, which keeps its name and pose, see REP 105."""

WORLD = "odom"
"""Fixed frame that the robot moves in; the floor is its plane z = 0."""

NO_SPEED_LIMIT = 100.0
"""Speed limit for joints without one, rad/s or m/s: URDF requires a limit."""

Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class Shape:
    """A visible shape of a link.

    Attributes:
        kind: ``sphere``, ``box``, ``cylinder``, ``capsule`` or ``mesh``.
        size: In m: a sphere's (radius,); a box's three edges; a cylinder's or capsule's (length, radius), the length
            without the caps. For a mesh, its three scale factors.
        pose: Pose in the link's frame; cylinders and capsules lie along z.
        color: Red, green, blue, opacity, 0 to 1.
        mesh: File of a mesh.
    """

    kind: str
    size: tuple[float, ...]
    pose: Transform
    color: Color
    mesh: str = ""


@dataclass(frozen=True)
class Link:
    """A rigid part.

    Attributes:
        name: Its name, and that of its frame.
        mass: kg.
        inertia: Moments of inertia about the axes of the frame of the center of mass, kg m².
        center: Pose of the frame of the center of mass in the link's frame.
        shapes: Its visible shapes.
    """

    name: str
    mass: float
    inertia: Vector
    center: Transform
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class Joint:
    """A joint between two links; the child's frame is the joint's.

    Attributes:
        name: Its name.
        kind: ``revolute``, ``continuous``, ``prismatic`` or ``fixed``.
        parent: Name of the parent link.
        child: Name of the child link.
        origin: Pose of the child in the parent at position 0.
        axis: Unit vector in the child's frame.
        lower: Least position, rad or m; for revolute and prismatic joints.
        upper: Greatest position, likewise.
        effort: Greatest torque or force, N·m or N.
        velocity: Greatest speed, rad/s or m/s.
        index: Joint index in the simulator, of a movable joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Transform
    axis: Vector = ZERO
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    velocity: float = 0.0
    index: int = -1

    def pose(self, position: float = 0.0) -> Transform:
        """Return the pose of the child in the parent at a position, rad or m."""
        if self.kind == "fixed":
            return self.origin
        return self.origin @ motion(self.kind, self.axis, position)


@dataclass(frozen=True)
class RobotModel:
    """A tree of links.

    Attributes:
        name: Name of the robot.
        links: Its links, base frame first.
        joints: Its joints, each after the joint of its parent.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    @property
    def base(self) -> str:
        """Name of the base frame: `BASE_LINK`, or another name if the robot has a link of that name."""
        return self.links[0].name

    @property
    def world(self) -> str:
        """Name of the fixed frame: `WORLD`, or another name if the robot has a link of that name."""
        return free_name([link.name for link in self.links], WORLD)

    @property
    def movable(self) -> tuple[Joint, ...]:
        """The joints that move, in the order of `RobotState.positions`."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    @property
    def fixed(self) -> tuple[Joint, ...]:
        """The fixed joints."""
        return tuple(joint for joint in self.joints if joint.kind == "fixed")


@dataclass(frozen=True)
class RobotState:
    """Pose and velocities of a robot.

    Attributes:
        base: Pose of the base frame in the world.
        linear: Velocity of its origin, m/s, in the world frame.
        angular: Angular velocity, rad/s, in the world frame.
        positions: Position of each movable joint, rad or m.
        velocities: Velocity of each movable joint, rad/s or m/s.
        told: Pose of the base frame as the simulator tells it to tasks: where the torso is a link in PyBullet, that of
            a substep ago.
        configuration: The whole state of the simulation's positions, for a simulator that draws its robots itself;
            empty for others.
    """

    base: Transform
    linear: Vector
    angular: Vector
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    told: Transform
    configuration: tuple[float, ...] = ()

    def as_told(self) -> RobotState:
        """Return the state that tasks, and the observations of their controllers, know of."""
        return replace(self, base=self.told)


def free_name(taken: Container[str], *wanted: str) -> str:
    """Return the first name that is not taken; if all are, the last one with a number appended."""
    numbered = (f"{wanted[-1]}_{number}" for number in count(2))
    return next(name for name in chain(wanted, numbered) if name not in taken)


def motion(kind: str, axis: Vector, position: float) -> Transform:
    """Return the transform of a movable joint at a position.

    Args:
        kind: As in `Joint`.
        axis: Unit vector.
        position: rad or m.
    """
    if kind == "prismatic":
        return Transform((axis[0] * position, axis[1] * position, axis[2] * position), UNTURNED)
    return Transform(ZERO, turn(axis, position))


def link_poses(model: RobotModel, state: RobotState) -> dict[str, Transform]:
    """Return the pose of every link's frame in the world, by link name."""
    positions = {joint.name: q for joint, q in zip(model.movable, state.positions, strict=True)}
    poses = {model.base: state.base}
    for joint in model.joints:
        poses[joint.child] = poses[joint.parent] @ joint.pose(positions.get(joint.name, 0.0))
    return poses
