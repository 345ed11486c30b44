"""The four robots of the QD locomotion tasks: what differs between them, as data.

Sizes, torques, limits and descriptors follow §4.1 of Nilsson & Cully (2021) and the locomotion
environments of PyBullet that the paper used. Nothing here imports pybullet.
"""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.tasks.spec import TaskSpec

CONTROL_PERIOD = 0.0165 / 4 * 4
"""Time between two actions, s.

Written with the engine's four substeps, because that rounds differently from 0.0165.
"""

MAX_STEPS = 1000

OBSERVATION_LIMIT = 5.0
"""Every entry of an observation is limited to plus or minus this."""

_TORSO_NAMES = (
    "torso/height",
    "target/sin",
    "target/cos",
    "torso/velocity_forward",
    "torso/velocity_left",
    "torso/velocity_up",
    "torso/roll",
    "torso/pitch",
)
# "0.3 * (m/s)": the entry is 0.3 times the speed in m/s.
_TORSO_UNITS = ("m above start", "", "", *3 * ("0.3 * (m/s)",), "rad", "rad")
_JOINT_UNITS = ("-1 lower limit, +1 upper limit", "0.1 * (rad/s)")
_CONTACT_UNIT = "1 if touching the floor one step ago, else 0"


@dataclass(frozen=True)
class Robot:
    """Constants of one robot.

    Attributes:
        model: File below ``mjcf/`` of pybullet_data.
        torso_is_base: Whether the torso is the free base of the body (Ant); otherwise it is a link that
            slides and a hinge connect to the world.
        joint_limits: Lower and upper limit of each actuated joint as PyBullet reads the model, rad, in the order of
            `torques`.
        torques: Torque of each actuated joint at an action of 1, N·m, in the order of the joint
            indices.
        contact_links: Links whose contact with the floor is observed, in the order of the
            observation.
        feet: Links whose shares of time on the floor are the behavior descriptor, in its order.
        min_height: The torso must stay above this height, m; None for no limit.
        max_pitch: The torso's pitch must stay below this angle, rad; None for no limit.
        bruising_links: Links whose contact with the floor costs the alive bonus.
        can_fall: Whether losing the alive bonus ends the episode.
    """

    model: str
    torso_is_base: bool
    torques: dict[str, float]
    joint_limits: tuple[tuple[float, float], ...]
    contact_links: tuple[str, ...]
    feet: tuple[str, ...]
    min_height: float | None
    max_pitch: float | None
    bruising_links: tuple[str, ...]
    can_fall: bool


def build_spec(name: str, robot: Robot, cells: int, bins: tuple[int, ...]) -> TaskSpec:
    """Return the spec of a locomotion task.

    Args:
        name: Name of the task.
        robot: Its robot.
        cells: Default number of cells of a CVT archive.
        bins: Default bins per descriptor dimension of a grid archive.
    """
    joints, links = tuple(robot.torques), robot.contact_links
    joint_names = tuple(f"{joint}/{what}" for joint in joints for what in ("position", "velocity"))
    entries = len(_TORSO_NAMES) + len(joint_names) + len(links)
    return TaskSpec(
        name=name,
        observation_names=_TORSO_NAMES + joint_names + tuple(f"{link}/contact" for link in links),
        observation_units=_TORSO_UNITS + _JOINT_UNITS * len(joints) + (_CONTACT_UNIT,) * len(links),
        action_names=tuple(f"{joint}/torque" for joint in joints),
        action_units=tuple(f"{torque:g} N·m" for torque in robot.torques.values()),
        action_low=(-1.0,) * len(joints),
        action_high=(1.0,) * len(joints),
        descriptor_names=tuple(f"{foot}/contact_share" for foot in robot.feet),
        descriptor_low=(0.0,) * len(robot.feet),
        descriptor_high=(1.0,) * len(robot.feet),
        max_steps=MAX_STEPS,
        control_period=CONTROL_PERIOD,
        archive_cells=cells,
        archive_bins=bins,
        step_descriptor_names=tuple(f"{foot}/contact" for foot in robot.feet),
        step_descriptor_delay=1,  # see _CONTACT_UNIT
        observation_low=(-OBSERVATION_LIMIT,) * entries,
        observation_high=(OBSERVATION_LIMIT,) * entries,
        joint_names=joints,
        joint_low=tuple(low for low, _ in robot.joint_limits),
        joint_high=tuple(high for _, high in robot.joint_limits),
    )


# Limits, rad: the models give degrees, which PyBullet converts in float32.
_LEG = (-2.6179940700531006, 0.0)
_FOOT = (-0.7853981852531433, 0.7853981852531433)
_HIP = (-0.6981317400932312, 0.6981317400932312)
_FORWARD = (0.5235987901687622, 1.7453292608261108)
_BACKWARD = (-1.7453292608261108, -0.5235987901687622)

WALKER = Robot(
    model="walker2d.xml",
    torso_is_base=False,
    torques={
        "thigh_joint": 40.0,
        "leg_joint": 40.0,
        "foot_joint": 12.0,
        "thigh_left_joint": 40.0,
        "leg_left_joint": 40.0,
        "foot_left_joint": 12.0,
    },
    joint_limits=2 * (_LEG, _LEG, _FOOT),
    contact_links=("foot", "foot_left"),
    feet=("foot", "foot_left"),
    min_height=0.8,
    max_pitch=1.0,
    bruising_links=(),
    can_fall=True,
)

HALF_CHEETAH = Robot(
    model="half_cheetah.xml",
    torso_is_base=False,
    torques={
        "bthigh": 108.0,
        "bshin": 81.0,
        "bfoot": 54.0,
        "fthigh": 126.0,
        "fshin": 54.0,
        "ffoot": 27.0,
    },
    joint_limits=(
        (-0.5199999809265137, 1.0499999523162842),
        (-0.7850000262260437, 0.7850000262260437),
        (-0.4000000059604645, 0.7850000262260437),
        (-1.5, 0.800000011920929),
        (-1.2000000476837158, 1.100000023841858),
        (-3.0999999046325684, -0.30000001192092896),
    ),
    contact_links=("ffoot", "fshin", "fthigh", "bfoot", "bshin", "bthigh"),
    feet=("ffoot", "bfoot"),
    min_height=None,
    max_pitch=1.0,
    bruising_links=("fshin", "fthigh", "bshin", "bthigh"),
    can_fall=False,
)

ANT = Robot(
    model="ant.xml",
    torso_is_base=True,
    torques={f"{joint}_{leg}": 250.0 for leg in (1, 2, 3, 4) for joint in ("hip", "ankle")},
    joint_limits=(_HIP, _FORWARD, _HIP, _BACKWARD, _HIP, _BACKWARD, _HIP, _FORWARD),
    contact_links=("front_left_foot", "front_right_foot", "left_back_foot", "right_back_foot"),
    feet=("front_left_foot", "front_right_foot", "left_back_foot", "right_back_foot"),
    min_height=0.26,
    max_pitch=None,
    bruising_links=(),
    can_fall=True,
)

HOPPER = Robot(
    model="hopper.xml",
    torso_is_base=False,
    torques={"thigh_joint": 75.0, "leg_joint": 75.0, "foot_joint": 75.0},
    joint_limits=(_LEG, _LEG, _FOOT),
    contact_links=("foot",),
    feet=("foot",),
    min_height=0.8,
    max_pitch=1.0,
    bruising_links=(),
    can_fall=True,
)
