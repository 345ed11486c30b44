"""Behaviors as a robot's program sees them: values read from the repertoire's messages, and controllers to run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pga_me_msgs.msg import Behavior as BehaviorMsg
from pga_me_msgs.msg import Controller as ControllerMsg
from pga_me_msgs.srv import GetBehavior, GetBehaviors, GetInfo

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.networks.controller import MlpController as Network
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.errors import NetworkError


class Controller:
    """A controller of the repertoire: observation in, action out, NumPy alone.

    It gives, bit for bit, the actions of the evaluation that the behavior's fitness comes from. One thread at a time
    may call it.

    Attributes:
        task: Name of the task that it was learned in.
        layer_sizes: Neurons per layer, from the observation to the action.
        parameters: (P,) float32, per layer the weights (out, in) row by row, then the biases; read-only.
        observation_names: What each entry of the observation is.
        observation_units: Unit of each entry.
        action_names: What each entry of the action drives.
        action_units: Unit of each entry.
        action_low: Least value of each action entry.
        action_high: Greatest value of each action entry.
        control_period: Seconds between two actions.
    """

    def __init__(self, msg: ControllerMsg) -> None:
        """Use `from_msg`."""
        shape = _checked_shape(msg)
        self.task: str = msg.task
        self.layer_sizes = shape.sizes
        self.parameters = np.array(msg.parameters, np.float32)
        self.parameters.flags.writeable = False
        self.observation_names = tuple(msg.observation_names)
        self.observation_units = tuple(msg.observation_units)
        self.action_names = tuple(msg.action_names)
        self.action_units = tuple(msg.action_units)
        self.action_low = _read_only(msg.action_low)
        self.action_high = _read_only(msg.action_high)
        self.control_period: float = msg.control_period
        self._network = Network(shape, self.parameters)
        self._inputs = (shape.sizes[0],)

    @classmethod
    def from_msg(cls, msg: ControllerMsg) -> Controller:
        """Make the controller that a message describes.

        Raises:
            NetworkError: Its layers, activations, parameters or names do not fit each other, or a parameter is not
                finite.
        """
        return cls(msg)

    def __call__(self, observation: ArrayLike) -> Float32Array:
        """Return the action for an observation.

        Args:
            observation: (observation_dim,) numbers in the order and units of `observation_names`; rounded to float32.

        Returns:
            (action_dim,) float32 within ±1, a fresh array.

        Raises:
            NetworkError: The observation has another shape, or is not finite: no actuator must ever be told NaN.
        """
        values = np.asarray(observation, np.float32)
        if values.shape != self._inputs or not np.isfinite(values).all():
            raise NetworkError(self._complaint(values))
        return self._network(values)

    def _complaint(self, values: Float32Array) -> str:
        if values.shape != self._inputs:
            return (
                f"The observation has the shape {values.shape}; this controller takes {self._inputs}: "
                f"{', '.join(self.observation_names)}."
            )
        bad = int(np.flatnonzero(~np.isfinite(values))[0])
        return (
            f"Entry {bad} of the observation ({self.observation_names[bad]}) is {values[bad]}; "
            "give finite numbers, and stop the robot when a sensor fails."
        )


@dataclass(frozen=True, eq=False)
class ListedBehavior:
    """What the repertoire knows of a behavior.

    Attributes:
        cell: Its cell in the archive; ask for it by this number.
        descriptor: (d,) float64 achieved descriptor, read-only.
        fitness: Sum of rewards in its one evaluation.
        evaluation: Id of that evaluation within the run.
        generation: Generation that it was made in.
        made_by: Operator that made it (`pga_me_ros.core.operators`), for example ``pg``.
        parents: Evaluation ids of its parents, at most two.
        steps: Length of that evaluation, control steps.
        terminated: Whether it ended by a fall.
        repeats: Re-evaluations from other initial poses that the repertoire knows of, 0 for none.
        mean_fitness: Mean of their fitness, NaN for none.
        fitness_spread: Sample standard deviation of their fitness, NaN for fewer than two.
        mean_descriptor: (d,) float64 mean of their descriptors, read-only; empty for none.
        descriptor_spread: (d,) float64 sample standard deviation of each entry; empty for fewer than two.
    """

    cell: int
    descriptor: Float64Array
    fitness: float
    evaluation: int
    generation: int
    made_by: str
    parents: tuple[int, ...]
    steps: int
    terminated: bool
    repeats: int
    mean_fitness: float
    fitness_spread: float
    mean_descriptor: Float64Array
    descriptor_spread: Float64Array

    @classmethod
    def from_msg(cls, msg: BehaviorMsg) -> ListedBehavior:
        """Return the behavior of a message."""
        return cls(**_fields(msg))


@dataclass(frozen=True, eq=False)
class Behavior(ListedBehavior):
    """A behavior with all that it takes to run it.

    Attributes:
        distance: Euclidean distance from its (mean) descriptor to the wanted one, each dimension in shares of its
            range; 0 where none was wanted.
        controller: Its controller.
    """

    distance: float
    controller: Controller

    @classmethod
    def from_response(cls, response: GetBehavior.Response) -> Behavior:
        """Return the behavior of an answer that found one.

        Raises:
            NetworkError: Its controller is malformed, see `Controller.from_msg`.
        """
        return cls(
            **_fields(response.behavior),
            distance=response.distance,
            controller=Controller.from_msg(response.controller),
        )

    @classmethod
    def all_from_response(cls, response: GetBehaviors.Response) -> tuple[Behavior, ...]:
        """Return the behaviors of an answer with controllers.

        Raises:
            NetworkError: A controller is malformed, see `Controller.from_msg`.
        """
        if not response.behaviors:
            return ()
        msg, count = response.controller, len(response.behaviors)
        size = MlpShape(tuple(msg.layer_sizes)).parameter_count
        if len(response.parameters) != count * size or len(response.distances) != count:
            raise NetworkError(
                f"The answer has {len(response.parameters)} parameters and {len(response.distances)} distances for "
                f"{count} behaviors with {size} parameters each; the message is malformed."
            )
        out = []
        for i, behavior in enumerate(response.behaviors):
            msg.parameters = response.parameters[i * size : (i + 1) * size]
            controller = Controller.from_msg(msg)
            fields = _fields(behavior)
            out.append(cls(**fields, distance=response.distances[i], controller=controller))
        return tuple(out)


@dataclass(frozen=True, eq=False)
class RepertoireInfo:
    """What a repertoire is and how far it has come.

    Attributes:
        run_id: Run that grew it.
        task: Name of the task.
        archive: ``cvt`` or ``grid``.
        descriptor_names: What each descriptor entry is.
        descriptor_low: (d,) float64 least values.
        descriptor_high: (d,) float64 greatest values.
        settings: Settings of the run by name.
        versions: Versions of the libraries that it was made with, by name.
        growing: Whether a run adds to it.
        generation: Last finished generation, -1 before the first.
        evaluations: Evaluations so far.
        cells: Cells of the archive.
        coverage: Filled cells.
        qd_score: Sum of the elites' fitness.
        max_fitness: Fitness of the best elite, NaN while there is none.
        mean_fitness: Mean fitness of the elites, NaN while there are none.
    """

    run_id: str
    task: str
    archive: str
    descriptor_names: tuple[str, ...]
    descriptor_low: Float64Array
    descriptor_high: Float64Array
    settings: Mapping[str, Any]
    versions: Mapping[str, str]
    growing: bool
    generation: int
    evaluations: int
    cells: int
    coverage: int
    qd_score: float
    max_fitness: float
    mean_fitness: float

    @classmethod
    def from_response(cls, response: GetInfo.Response) -> RepertoireInfo:
        """Return the description in an answer."""
        metrics = response.metrics
        return cls(
            run_id=response.run_id,
            task=response.task,
            archive=response.archive,
            descriptor_names=tuple(response.descriptor_names),
            descriptor_low=_read_only(response.descriptor_low),
            descriptor_high=_read_only(response.descriptor_high),
            settings=json.loads(response.settings),
            versions=json.loads(response.versions),
            growing=response.growing,
            generation=metrics.generation,
            evaluations=metrics.evaluations,
            cells=metrics.cells,
            coverage=metrics.coverage,
            qd_score=metrics.qd_score,
            max_fitness=metrics.max_fitness,
            mean_fitness=metrics.mean_fitness,
        )


def _fields(msg: BehaviorMsg) -> dict[str, Any]:
    return {
        "cell": msg.cell,
        "descriptor": _read_only(msg.descriptor),
        "fitness": msg.fitness,
        "evaluation": msg.evaluation,
        "generation": msg.generation,
        "made_by": msg.made_by,
        "parents": tuple(msg.parents),
        "steps": msg.steps,
        "terminated": msg.terminated,
        "repeats": msg.repeats,
        "mean_fitness": msg.mean_fitness,
        "fitness_spread": msg.fitness_spread,
        "mean_descriptor": _read_only(msg.mean_descriptor),
        "descriptor_spread": _read_only(msg.descriptor_spread),
    }


def _read_only(numbers: Any) -> Float64Array:
    values = np.array(numbers, np.float64)
    values.flags.writeable = False
    return values


def _checked_shape(msg: ControllerMsg) -> MlpShape:
    """Return the layers of a controller's message.

    Raises:
        NetworkError: Its fields do not fit each other. The number and values of its parameters are not looked at.
    """
    shape = MlpShape(tuple(msg.layer_sizes))
    expected = ["relu"] * (len(shape.sizes) - 2) + ["tanh"]
    if list(msg.activations) != expected:
        raise NetworkError(
            f"The controller's activations are {list(msg.activations)}, but layers {list(shape.sizes)} of this "
            f"version take {expected}; use the pga_me_ros that serves the repertoire."
        )
    widths = {"observation_names": 0, "observation_units": 0}
    widths |= {"action_names": -1, "action_units": -1, "action_low": -1, "action_high": -1}
    for name, layer in widths.items():
        if len(getattr(msg, name)) != shape.sizes[layer]:
            raise NetworkError(
                f"The controller has {len(getattr(msg, name))} {name}, but its layers {list(shape.sizes)} need "
                f"{shape.sizes[layer]}; the message is malformed."
            )
    return shape
