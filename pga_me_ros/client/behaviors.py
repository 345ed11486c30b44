"""Behaviors as plain values, read from the repertoire's messages."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pga_me_msgs.msg import Behavior as BehaviorMsg
from pga_me_msgs.msg import Controller as ControllerMsg
from pga_me_msgs.srv import GetBehavior, GetBehaviors, GetInfo

from pga_me_ros.arrays import Float64Array
from pga_me_ros.client.controller import Controller, read_only
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.known_behavior import KnownBehavior
from pga_me_ros.errors import NetworkError


@dataclass(frozen=True, eq=False)
class ListedBehavior(KnownBehavior):
    """A behavior as listed by the repertoire.

    Attributes:
        cell: Its cell in the archive; `get_behavior(cell=...)` takes this number.
        descriptor: (d,) float64 achieved descriptor, read-only.
        fitness: Sum of rewards in its single evaluation.
        evaluation: Id of that evaluation within the run.
        generation: Generation that it was made in.
        made_by: Operator that made it (`pga_me_ros.core.operators`), for example ``pg``.
        parents: Evaluation ids of its parents, at most two.
        steps: Length of that evaluation, control steps.
        terminated: Whether it ended in a fall.
        repeats: Number of its re-evaluations from other initial poses, 0 for none.
        mean_fitness: Mean of their fitness, NaN for none.
        fitness_spread: Sample standard deviation of their fitness, NaN for fewer than two.
        mean_descriptor: (d,) float64 mean of their descriptors, read-only; empty for none.
        descriptor_spread: (d,) float64 sample standard deviation of each entry; empty for fewer than two.
        fall_share: Share of them that ended in a fall, NaN for none.
        by_mean: Whether it was chosen by these means rather than by its single evaluation.
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
    fall_share: float
    by_mean: bool

    @classmethod
    def from_msg(cls, msg: BehaviorMsg) -> ListedBehavior:
        """Return the behavior in a message."""
        return cls(**_fields(msg))


@dataclass(frozen=True, eq=False)
class FoundBehavior(ListedBehavior):
    """A behavior found for a request, without its controller.

    Attributes:
        distance: Euclidean distance from its promised descriptor to the requested one, each dimension in shares of its
            range; 0 if no descriptor was requested.
    """

    distance: float

    @classmethod
    def found(cls, response: GetBehavior.Response) -> FoundBehavior:
        """Return the behavior in a response that found one."""
        return FoundBehavior(**_fields(response.behavior), distance=response.distance)

    @classmethod
    def all_found(cls, response: GetBehaviors.Response) -> tuple[FoundBehavior, ...]:
        """Return the behaviors in a response.

        Raises:
            NetworkError: The numbers of distances and behaviors differ.
        """
        if len(response.distances) != len(response.behaviors):
            raise NetworkError(
                f"The answer has {len(response.distances)} distances for {len(response.behaviors)} behaviors; the "
                "message is malformed."
            )
        pairs = zip(response.behaviors, response.distances, strict=True)
        return tuple(FoundBehavior(**_fields(msg), distance=distance) for msg, distance in pairs)


@dataclass(frozen=True, eq=False)
class Behavior(FoundBehavior):
    """A behavior, ready to run.

    Attributes:
        controller: Its controller.
    """

    controller: Controller

    @classmethod
    def from_response(cls, response: GetBehavior.Response) -> Behavior:
        """Return the behavior in a response that found one.

        Raises:
            NetworkError: Its controller is malformed, see `Controller.from_msg`.
        """
        return cls.of(response.behavior, response.controller, response.distance)

    @classmethod
    def of(
        cls, behavior: BehaviorMsg, controller: ControllerMsg, distance: float = 0.0
    ) -> Behavior:
        """Return the behavior of a message and that of its controller.

        Raises:
            NetworkError: The controller is malformed, see `Controller.from_msg`.
        """
        own = Controller.from_msg(controller)
        return cls(**_fields(behavior), distance=distance, controller=own)

    @classmethod
    def all_from_response(cls, response: GetBehaviors.Response) -> tuple[Behavior, ...]:
        """Return the behaviors in a response with controllers.

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
    """Description of a repertoire and its progress.

    Attributes:
        run_id: Run that grew it.
        task: Name of the task.
        archive: ``cvt`` or ``grid``.
        descriptor_names: What each descriptor entry is.
        descriptor_low: (d,) float64 lower bounds.
        descriptor_high: (d,) float64 upper bounds.
        settings: Settings of the run by name.
        versions: Versions of the libraries that it was made with, by name.
        growing: Whether a run adds to it.
        generation: Last finished generation, -1 before the first.
        evaluations: Number of evaluations so far.
        cells: Number of cells of the archive.
        coverage: Number of filled cells.
        qd_score: Sum of the elites' fitness.
        max_fitness: Fitness of the best elite, NaN while there is none.
        mean_fitness: Mean fitness of the elites, NaN while there are none.
        corrected_repeats: Least number of re-evaluations of an elite; 0 unless all were re-evaluated.
        corrected_coverage: Filled cells of the corrected archive (`Metrics.msg`), 0 while unknown.
        corrected_qd_score: Sum of the mean fitness of its elites, NaN while unknown.
        corrected_max_fitness: Greatest mean fitness, NaN while unknown.
        corrected_fall_share: Share of re-evaluations that ended in a fall, NaN while unknown.
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
    corrected_repeats: int
    corrected_coverage: int
    corrected_qd_score: float
    corrected_max_fitness: float
    corrected_fall_share: float

    @classmethod
    def from_response(cls, response: GetInfo.Response) -> RepertoireInfo:
        """Return the description in a response."""
        metrics = response.metrics
        return cls(
            run_id=response.run_id,
            task=response.task,
            archive=response.archive,
            descriptor_names=tuple(response.descriptor_names),
            descriptor_low=read_only(response.descriptor_low),
            descriptor_high=read_only(response.descriptor_high),
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
            corrected_repeats=metrics.corrected_repeats,
            corrected_coverage=metrics.corrected_coverage,
            corrected_qd_score=metrics.corrected_qd_score,
            corrected_max_fitness=metrics.corrected_max_fitness,
            corrected_fall_share=metrics.corrected_fall_share,
        )


def _fields(msg: BehaviorMsg) -> dict[str, Any]:
    return {
        "cell": msg.cell,
        "descriptor": read_only(msg.descriptor),
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
        "mean_descriptor": read_only(msg.mean_descriptor),
        "descriptor_spread": read_only(msg.descriptor_spread),
        "fall_share": msg.fall_share,
        "by_mean": msg.by_mean,
    }
