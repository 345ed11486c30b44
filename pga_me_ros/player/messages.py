"""Messages from which ROS tools draw a robot: joint states, transforms, odometry."""

from __future__ import annotations

import array

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform as TransformMsg
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from pga_me_ros.player.model import Joint, RobotModel, RobotState
from pga_me_ros.player.transform import Transform, Vector, conjugate, rotate


class RobotMessages:
    """Makes the messages of one robot; each call updates and returns the same object.

    Args:
        model: The robot.
        prefix: Prefix of all frame names, but not of joint names, as in robot_state_publisher.
    """

    def __init__(self, model: RobotModel, prefix: str = "") -> None:
        self._model = model
        self._prefix = prefix
        movable = model.movable
        self._joints = JointState(name=[joint.name for joint in movable])
        self._frames = TFMessage(
            transforms=[
                self._between(prefix + model.world, prefix + model.base),
                *map(self._of, movable),
            ]
        )
        self._odometry = Odometry(child_frame_id=prefix + model.base)
        self._odometry.header.frame_id = prefix + model.world

    def joint_state(self, state: RobotState, stamp: Time) -> JointState:
        """Return positions and velocities of the movable joints."""
        msg = self._joints
        msg.header.stamp = stamp
        msg.position = array.array("d", state.positions)
        msg.velocity = array.array("d", state.velocities)
        return msg

    def moving_frames(self, state: RobotState, stamp: Time) -> TFMessage:
        """Return the pose of the base in the world, and of each link that a movable joint moves in its parent."""
        poses = [
            state.base,
            *(
                joint.pose(position)
                for joint, position in zip(self._model.movable, state.positions, strict=True)
            ),
        ]
        for transform, pose in zip(self._frames.transforms, poses, strict=True):
            transform.header.stamp = stamp
            _fill(transform.transform, pose)
        return self._frames

    def fixed_frames(self, stamp: Time) -> TFMessage:
        """Return the poses that never change."""
        transforms = [self._of(joint) for joint in self._model.fixed]
        for transform, joint in zip(transforms, self._model.fixed, strict=True):
            transform.header.stamp = stamp
            _fill(transform.transform, joint.pose())
        return TFMessage(transforms=transforms)

    def odometry(self, state: RobotState, stamp: Time) -> Odometry:
        """Return the pose of the base in the world, and its velocity in the base frame, as nav_msgs defines it."""
        msg = self._odometry
        msg.header.stamp = stamp
        position, orientation = msg.pose.pose.position, msg.pose.pose.orientation
        position.x, position.y, position.z = state.base.position
        orientation.x, orientation.y, orientation.z, orientation.w = state.base.rotation
        for vector, values in (
            (msg.twist.twist.linear, in_base(state, state.linear)),
            (msg.twist.twist.angular, in_base(state, state.angular)),
        ):
            vector.x, vector.y, vector.z = values
        return msg

    def _of(self, joint: Joint) -> TransformStamped:
        return self._between(self._prefix + joint.parent, self._prefix + joint.child)

    def _between(self, parent: str, child: str) -> TransformStamped:
        msg = TransformStamped(child_frame_id=child)
        msg.header.frame_id = parent
        return msg


def in_base(state: RobotState, vector: Vector) -> Vector:
    """Return a vector of the world in the axes of the robot's base."""
    return rotate(conjugate(state.base.rotation), vector)


def stamp_of(nanoseconds: int) -> Time:
    """Return a time as a message."""
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def _fill(msg: TransformMsg, pose: Transform) -> None:
    translation, rotation = msg.translation, msg.rotation
    translation.x, translation.y, translation.z = pose.position
    rotation.x, rotation.y, rotation.z, rotation.w = pose.rotation
