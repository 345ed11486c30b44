"""A robot as ROS tools see it: links with shapes, joints between them, and the poses that follow."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from itertools import chain, count

from pga_me_ros.player.transform import UNTURNED, ZERO, Transform, Vector, turn

BASE_LINK = "base_link"
"""Frame of the whole robot: the torso's center of mass, turned as the torso."""

TORSO_CENTER = "torso_center"
"""Name of that frame where the robot has a `BASE_LINK` of its own, which keeps its name and place, see REP 105."""

WORLD = "odom"
"""Frame that the robot moves in: the floor is its plane z = 0."""

Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class Shape:
    """What is seen of a link.

    Attributes:
        kind: ``sphere``, ``box``, ``cylinder``, ``capsule`` or ``mesh``.
        size: m: (radius,); the three edges; (length, radius), a capsule's without its caps; or a mesh's three scales.
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
        shapes: What is seen of it.
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
        parent: Name of the link that it hangs on.
        child: Name of the link that it moves.
        origin: Pose of the child in the parent at position 0.
        axis: Unit vector in the child's frame.
        lower: Least position, rad or m; for revolute and prismatic joints.
        upper: Greatest position.
        effort: Greatest torque or force, N·m or N.
        velocity: Greatest speed, rad/s or m/s.
        index: Joint index in PyBullet, of a movable joint.
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
        links: Its links, that of the whole robot first.
        joints: Its joints, each after the one that moves its parent.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    @property
    def base(self) -> str:
        """Name of the frame of the whole robot: `BASE_LINK`, or another where the robot has one of that name."""
        return self.links[0].name

    @property
    def world(self) -> str:
        """Name of the frame that the robot moves in: `WORLD`, or another where the robot has one of that name."""
        return free_name([link.name for link in self.links], WORLD)

    @property
    def movable(self) -> tuple[Joint, ...]:
        """The joints that move, in the order of `RobotState.positions`."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    @property
    def fixed(self) -> tuple[Joint, ...]:
        """The joints that do not."""
        return tuple(joint for joint in self.joints if joint.kind == "fixed")


@dataclass(frozen=True)
class RobotState:
    """Where a robot is and how it moves.

    Attributes:
        base: Pose of the frame of the whole robot in the world.
        linear: Velocity of its origin, m/s, in axes of the world.
        angular: Angular velocity, rad/s, in axes of the world.
        positions: Position of each movable joint, rad or m.
        velocities: Velocity of each movable joint, rad/s or m/s.
    """

    base: Transform
    linear: Vector
    angular: Vector
    positions: tuple[float, ...]
    velocities: tuple[float, ...]


def free_name(taken: Container[str], *wanted: str) -> str:
    """Return the first of some names that is not taken; if all are, the last one with a number behind it."""
    numbered = (f"{wanted[-1]}_{number}" for number in count(2))
    return next(name for name in chain(wanted, numbered) if name not in taken)


def motion(kind: str, axis: Vector, position: float) -> Transform:
    """Return what a movable joint does to its child's frame.

    Args:
        kind: As in `Joint`.
        axis: Unit vector.
        position: rad or m.
    """
    if kind == "prismatic":
        return Transform((axis[0] * position, axis[1] * position, axis[2] * position), UNTURNED)
    return Transform(ZERO, turn(axis, position))


def link_poses(model: RobotModel, state: RobotState) -> dict[str, Transform]:
    """Return the pose of every link's frame in the world by its name."""
    positions = {joint.name: q for joint, q in zip(model.movable, state.positions, strict=True)}
    poses = {model.base: state.base}
    for joint in model.joints:
        poses[joint.child] = poses[joint.parent] @ joint.pose(positions.get(joint.name, 0.0))
    return poses
