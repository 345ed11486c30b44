"""Description of a task: names, units, limits and sizes, available without a simulator."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pga_me_ros.errors import TaskError, nearest_name

_NAMES = ("observation_names", "action_names", "descriptor_names")
_UNITS = ("observation_units", "action_units")
_LIMITS = ("action_low", "action_high", "descriptor_low", "descriptor_high")


@dataclass(frozen=True)
class TaskSpec:
    """Description of a task that other processes can read without pybullet.

    Attributes:
        name: Name of the task, for example ``"qd_walker"``.
        observation_names: One name per entry of the observation, in its order.
        observation_units: Unit of each entry, ``""`` for a pure number.
        action_names: One name per entry of the action, in its order.
        action_units: Unit of each entry.
        action_low: Lowest useful value of each action entry; a controller's tanh gives -1.
        action_high: Highest useful value of each action entry.
        descriptor_names: One name per descriptor dimension.
        descriptor_low: Lower bound of each descriptor dimension.
        descriptor_high: Upper bound of each descriptor dimension.
        max_steps: Time limit of an episode, steps.
        control_period: Time between two actions, s.
        archive_cells: Default number of cells of a CVT archive.
        archive_bins: Default number of bins per descriptor dimension of a grid archive.
        step_descriptor_names: One observation entry per descriptor dimension, whose mean over an episode's steps is its
            descriptor; empty if the descriptor is something else. Algorithm `qd_rl` needs them.
        step_descriptor_delay: 0 if the observation that a step returns shows what the step adds to these means, 1 if
            that of the step after it does.
        observation_low: Least value of each observation entry; empty if unknown, or if an entry has no limit.
        observation_high: Greatest value of each observation entry; as long as `observation_low`.
        joint_names: Joints whose position is the observation entry ``NAME/position``, as -1 at the lower and +1 at the
            upper limit; empty if there are none.
        joint_low: Lower limit of each of them, rad or m.
        joint_high: Upper limit of each of them, rad or m.

    Raises:
        TaskError: A field has the wrong type or length, or low is not below high, or their difference is not finite.
    """

    name: str
    observation_names: tuple[str, ...]
    observation_units: tuple[str, ...]
    action_names: tuple[str, ...]
    action_units: tuple[str, ...]
    action_low: tuple[float, ...]
    action_high: tuple[float, ...]
    descriptor_names: tuple[str, ...]
    descriptor_low: tuple[float, ...]
    descriptor_high: tuple[float, ...]
    max_steps: int
    control_period: float
    archive_cells: int
    archive_bins: tuple[int, ...]
    step_descriptor_names: tuple[str, ...] = ()
    step_descriptor_delay: int = 0
    observation_low: tuple[float, ...] = ()
    observation_high: tuple[float, ...] = ()
    joint_names: tuple[str, ...] = ()
    joint_low: tuple[float, ...] = ()
    joint_high: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check every field, so that every spec that exists is valid."""
        if not isinstance(self.name, str) or not self.name:
            raise TaskError(f"TaskSpec.name is {self.name!r}; expected a non-empty string")
        for field in _NAMES:
            self._check_names(field)
        for field in _UNITS:
            self._check_tuple(field, str, self._length(field.replace("units", "names")))
        for field in _LIMITS:
            self._check_tuple(field, float, self._length(field.split("_")[0] + "_names"))
        self._check_tuple("archive_bins", int, self.descriptor_dim)
        for kind in ("action", "descriptor"):
            self._check_bounds(kind)
        self._check_sizes()
        self._check_step_descriptor()
        self._check_measured()

    @property
    def observation_dim(self) -> int:
        """Number of entries of an observation."""
        return len(self.observation_names)

    @property
    def action_dim(self) -> int:
        """Number of entries of an action."""
        return len(self.action_names)

    @property
    def descriptor_dim(self) -> int:
        """Number of descriptor dimensions."""
        return len(self.descriptor_names)

    def to_json(self) -> dict[str, Any]:
        """Return strings, numbers and lists by field, which `from_json` turns back into a spec."""
        fields = dataclasses.asdict(self)
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in fields.items()
        }

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> TaskSpec:
        """Return the spec that `to_json` described.

        Args:
            fields: One entry per field of the dataclass, sequences as lists; those that have defaults may be missing,
                as in files of older versions.

        Raises:
            TaskError: A field is missing, unknown or invalid.
        """
        if not isinstance(fields, Mapping):
            raise TaskError(f"a task spec is a JSON object, not {type(fields).__name__}")
        known = [field.name for field in dataclasses.fields(cls)]
        for name in fields:
            if name not in known:
                raise TaskError(f"unknown task spec field '{name}'{nearest_name(str(name), known)}")
        missing = [name for name in known if name not in OPTIONAL_FIELDS and name not in fields]
        if missing:
            raise TaskError(f"task spec lacks the fields {missing}; write it with TaskSpec.to_json")
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in fields.items()
        }
        return cls(**values)

    def _length(self, field: str) -> int:
        return len(getattr(self, field))

    def _check_names(self, field: str) -> None:
        names = getattr(self, field)
        self._check_tuple(field, str, None)
        if not names or not all(names):
            raise TaskError(f"TaskSpec.{field} is {names}; expected at least one non-empty name")
        if len(set(names)) != len(names):
            raise TaskError(f"TaskSpec.{field} names something twice; names must be unique")

    def _check_tuple(self, field: str, kind: type, length: int | None) -> None:
        values: Sequence[Any] = getattr(self, field)
        if not isinstance(values, tuple) or any(type(value) is not kind for value in values):
            raise TaskError(f"TaskSpec.{field} is {values!r}; expected a tuple of {kind.__name__}")
        if length is not None and len(values) != length:
            raise TaskError(f"TaskSpec.{field} has {len(values)} entries; expected {length}")

    def _check_bounds(self, kind: str) -> None:
        pairs = zip(getattr(self, f"{kind}_low"), getattr(self, f"{kind}_high"), strict=True)
        for index, (low, high) in enumerate(pairs):
            if not (low < high and math.isfinite(high - low)):
                raise TaskError(
                    f"TaskSpec.{kind}_low[{index}] is {low} and {kind}_high[{index}] is {high}; "
                    "expected finite numbers with low < high and a finite difference"
                )

    def _check_sizes(self) -> None:
        for field in ("max_steps", "archive_cells"):
            value = getattr(self, field)
            if type(value) is not int or value < 1:
                raise TaskError(f"TaskSpec.{field} is {value!r}; expected an int of at least 1")
        if any(bins < 1 for bins in self.archive_bins):
            raise TaskError(f"TaskSpec.archive_bins is {self.archive_bins}; expected bins >= 1")
        period = self.control_period
        if type(period) is not float or not (math.isfinite(period) and period > 0.0):
            raise TaskError(f"TaskSpec.control_period is {period!r}; expected a float above 0 (s)")

    def _check_step_descriptor(self) -> None:
        names, delay = self.step_descriptor_names, self.step_descriptor_delay
        self._check_tuple("step_descriptor_names", str, self.descriptor_dim if names else 0)
        for name in names:
            if name not in self.observation_names:
                raise TaskError(
                    f"TaskSpec.step_descriptor_names has '{name}', which is not an entry of the observation"
                    f"{nearest_name(name, self.observation_names)}"
                )
        if type(delay) is not int or delay not in (0, 1):
            raise TaskError(f"TaskSpec.step_descriptor_delay is {delay!r}; expected 0 or 1")

    def _check_measured(self) -> None:
        limits = ("observation_low", "observation_high")
        length = self.observation_dim if any(getattr(self, field) for field in limits) else 0
        for field in limits:
            self._check_tuple(field, float, length)
        self._check_tuple("joint_names", str, None)
        for field in ("joint_low", "joint_high"):
            self._check_tuple(field, float, len(self.joint_names))
        for kind in ("observation", "joint"):
            self._check_bounds(kind)
        for joint in self.joint_names:
            if f"{joint}/position" not in self.observation_names:
                raise TaskError(
                    f"TaskSpec.joint_names has '{joint}', but the observation has no entry '{joint}/position'"
                )


OPTIONAL_FIELDS = frozenset(
    field.name for field in dataclasses.fields(TaskSpec) if field.default is not dataclasses.MISSING
)
"""Fields that a task may omit, and that specs written by older versions lack."""
