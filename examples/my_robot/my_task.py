"""A task for your own robot: a box that crawls with an arm of two joints, from a URDF file.

From the checkout, with the environment of the README::

    export PYTHONPATH=$PWD/examples/my_robot:$PYTHONPATH
    python -m pga_me_ros.tasks.check my_task:Crawler
    python -m pga_me_ros.nodes.orchestrator --ros-args -p task:=my_task:Crawler -p evaluations:=5000
"""

from pathlib import Path

import numpy as np
import pybullet
import pybullet_data

from pga_me_ros.tasks.body import Body
from pga_me_ros.tasks.protocol import NonFiniteActionError
from pga_me_ros.tasks.spec import TaskSpec

URDF = str(Path(__file__).with_name("crawler.urdf"))
JOINTS = [0, 1]  # shoulder, elbow
MIDDLE, REACH = np.array([-0.3, 1.0]), np.array([0.9, 1.2])  # of the joints' ranges, rad
HAND = 1  # link
EFFORT = 8.0  # N m
SUBSTEPS = 8


class Crawler:
    """The fitness is how far it crawls; the descriptor is how its hand is used."""

    spec = TaskSpec(
        name="crawler",
        observation_names=(
            "shoulder/position",
            "elbow/position",
            "shoulder/velocity",
            "elbow/velocity",
            "body/pitch",
            "body/velocity_forward",
            "hand/contact",
        ),
        observation_units=(*2 * ("share of range",), *2 * ("0.1 rad/s",), "rad", "m/s", ""),
        action_names=("shoulder/target", "elbow/target"),
        action_units=("0.9 rad", "1.2 rad"),
        action_low=(-1.0, -1.0),
        action_high=(1.0, 1.0),
        descriptor_names=("hand/contact_share", "hand/mean_height_in_m"),
        descriptor_low=(0.0, 0.0),
        descriptor_high=(1.0, 0.5),
        max_steps=100,
        control_period=SUBSTEPS / 240,
        archive_cells=100,
        archive_bins=(10, 10),
    )

    def __init__(self, *, render=False):
        """Start a world; all episodes start from its present state."""
        self.client = pybullet.connect(pybullet.GUI if render else pybullet.DIRECT)
        pybullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1, physicsClientId=self.client
        )
        pybullet.setGravity(0, 0, -9.81, self.client)
        floor = str(Path(pybullet_data.getDataPath()) / "plane.urdf")
        self.floor = pybullet.loadURDF(floor, physicsClientId=self.client)
        self.robot = pybullet.loadURDF(URDF, [0, 0, 0.06], physicsClientId=self.client)
        self.start = pybullet.saveState(self.client)
        self._heights, self._touched = [], 0

    @property
    def body(self):
        """The robot, for `behavior_player` and `render`."""
        return Body(
            self.client,
            self.robot,
            model_path=URDF,
            efforts=dict.fromkeys(("shoulder", "elbow"), EFFORT),
        )

    def reset(self, rng):
        """Begin an episode with the arm somewhere above the floor."""
        pybullet.restoreState(self.start, physicsClientId=self.client)
        pybullet.performCollisionDetection(self.client)  # forgets the contacts of the last episode
        for joint, position in zip(JOINTS, rng.uniform((-0.6, 0.0), (-0.4, 0.2)), strict=True):
            pybullet.resetJointState(self.robot, joint, position, 0.0, self.client)
        self._heights, self._touched = [], 0
        return self._observation()

    def step(self, action):
        """Move the joints toward the positions of the action."""
        if not np.isfinite(action).all():
            raise NonFiniteActionError("the crawler got an action that is not finite")
        action = np.clip(np.asarray(action, np.float64), -1.0, 1.0)
        before = self._place()
        pybullet.setJointMotorControlArray(
            self.robot,
            JOINTS,
            pybullet.POSITION_CONTROL,
            targetPositions=(MIDDLE + REACH * action).tolist(),
            forces=[EFFORT] * 2,
            physicsClientId=self.client,
        )
        for _ in range(SUBSTEPS):
            pybullet.stepSimulation(self.client)
        self._touched += self._touches()
        self._heights.append(
            pybullet.getLinkState(self.robot, HAND, physicsClientId=self.client)[0][2]
        )
        speed = (self._place() - before) / self.spec.control_period
        reward = float(speed - 0.01 * np.mean(action**2))
        return self._observation(), reward, abs(self._tilt()[1]) > 1.2

    def descriptor(self):
        """Return the share of steps with the hand on the floor, and the hand's mean height, m."""
        steps = max(1, len(self._heights))
        height = np.mean(self._heights or [0.0])
        return np.clip(np.array([self._touched / steps, height]), *self._box())

    def close(self):
        """Stop the world."""
        if self.client >= 0:
            pybullet.disconnect(self.client)
            self.client = -1

    def _box(self):
        return np.array(self.spec.descriptor_low), np.array(self.spec.descriptor_high)

    def _place(self):
        return pybullet.getBasePositionAndOrientation(self.robot, self.client)[0][0]

    def _tilt(self):
        turned = pybullet.getBasePositionAndOrientation(self.robot, self.client)[1]
        return pybullet.getEulerFromQuaternion(turned)

    def _touches(self):
        return bool(pybullet.getContactPoints(self.robot, self.floor, HAND, -1, self.client))

    def _observation(self):
        states = pybullet.getJointStates(self.robot, JOINTS, self.client)
        position = (np.array([state[0] for state in states]) - MIDDLE) / REACH
        velocity = 0.1 * np.array([state[1] for state in states])
        forward = pybullet.getBaseVelocity(self.robot, self.client)[0][0]
        rest = [self._tilt()[1], forward, float(self._touches())]
        return np.clip(np.concatenate([position, velocity, rest]), -5.0, 5.0).astype(np.float32)
