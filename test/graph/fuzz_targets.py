"""The parts of the graph that belong to a run: valid messages to them, and faults that must be refused."""

from __future__ import annotations

import array
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fuzz_values import (
    BAD_RATES,
    STRINGS,
    Fault,
    bad_rates,
    ints,
    not_finite,
    numbers,
    of_length,
)

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.ros import names
from pga_me_ros.ros.convert import rates_to_msg
from pga_me_ros.tasks.spec import TaskSpec

FOREIGN = "ffffffff-1111-2222-3333-444444444444"
FAR = 10**6
"""Generations that no run of these tests reaches."""


@dataclass(frozen=True)
class World:
    """What a foreign node can know about a run from topics that anybody may subscribe to."""

    run_id: str
    spec: TaskSpec
    settings: Settings
    versions: str
    nodes: tuple[str, ...]
    host: str
    pids: tuple[int, ...]

    @property
    def shape(self) -> MlpShape:
        """Layers of the controllers."""
        return controller_shape(self.spec, self.settings)


@dataclass(frozen=True)
class Target:
    """A service or topic of the graph that belongs to a run.

    Attributes:
        name: Relative name.
        sound: Fields of a valid message.
        faults: Changes for which it must be refused.
        owned: Whether a foreign run id must be refused, too.
        harmless: Whether a valid message with the run's own id may be sent.
        generations: Fields that are relative to the newest committed generation.
    """

    name: str
    sound: Mapping[str, Any]
    faults: tuple[Fault, ...]
    owned: bool = True
    harmless: bool = False
    generations: tuple[str, ...] = ("generation",)


def run_targets(world: World, evaluator: str) -> list[Target]:
    """Return the services of the generation loop and the topics of its data.

    Args:
        world: The run.
        evaluator: Name of an evaluator.
    """
    parts: list[Callable[[World], Target]] = [
        add_target,
        sample_target,
        propose_target,
        train_target,
        store_target,
        transitions_target,
        snapshot_target,
        elites_target,
    ]
    return [*(part(world) for part in parts), evaluate_target(world, evaluator)]


def add_target(world: World) -> Target:
    """Return archive/add; all faults are in the content, for the next generation."""
    b, d, p = world.settings.batch_size, world.spec.descriptor_dim, world.shape.parameter_count
    sound = {
        "run_id": world.run_id,
        "generation": 1,
        "operators": numbers("B", b, 1),
        "parents": numbers("q", 2 * b, 0),
        "fitness": numbers("d", b, 1e6),
        "descriptors": numbers("d", b * d, 0.5),
        "steps": numbers("q", b, 10),
        "terminated": [False] * b,
        "parameters": numbers("f", b * p),
        "rates": rates_to_msg(Settings(n_evo=5)),
    }
    faults = [
        *of_length("fitness", "d", b),
        *not_finite("fitness", "d", b),
        *of_length("descriptors", "d", b * d),
        *not_finite("descriptors", "d", b * d),
        *of_length("parameters", "f", b * p),
        *not_finite("parameters", "f", b * p),
        *of_length("steps", "q", b),
        ("steps", numbers("q", b, -5)),
        *of_length("operators", "B", b),
        ("operators", numbers("B", b, 200)),
        *of_length("parents", "q", 2 * b),
        ("parents", numbers("q", 2 * b, -2)),
        ("terminated", [True] * (b + 1)),
        *(("rates", bad_rates(fault)) for fault in BAD_RATES),
        *ints("generation", FAR, 2**62, -FAR),
    ]
    return Target(names.ADD_TO_ARCHIVE, sound, tuple(faults))


def sample_target(world: World) -> Target:
    """Return archive/sample_parents, which only reads."""
    sound = {
        "run_id": world.run_id,
        "generation": 1,
        "first": 0,
        "count": 2,
        "parents_each": 2,
    }
    b = world.settings.batch_size
    faults = [
        *ints("generation", -FAR, FAR, 2**62),
        *ints("count", 0, -1, b + 1, 2**63 - 1),
        *ints("first", -1, -(2**63)),
        *ints("parents_each", 0, 3, -1, 2**62),
    ]
    return Target(names.SAMPLE_PARENTS, sound, tuple(faults), harmless=True)


def propose_target(world: World) -> Target:
    """Return variation/propose, which changes nothing."""
    b = world.settings.batch_size
    sound = {
        "run_id": world.run_id,
        "generation": 1,
        "operator_id": 1,
        "first": 1,
        "count": 2,
        "parents": numbers("q", 2 * 2, 5),
        "rates": rates_to_msg(Settings(n_evo=5)),
    }
    faults = [
        *ints("generation", -FAR, -(2**62)),
        *ints("operator_id", 3, 5, 6, 7, 8, 255),
        *ints("first", -1, b, 2**63 - 1),
        *ints("count", 0, -1, b + 1, 2**63 - 1),
        *of_length("parents", "q", 2 * 2),
        ("parents", numbers("q", 2 * 2, -1)),
        ("parents", numbers("q", 2 * 2, 2**62)),
        *(("rates", bad_rates(fault)) for fault in BAD_RATES),
    ]
    return Target(names.PROPOSE, sound, tuple(faults), harmless=True)


def train_target(world: World) -> Target:
    """Return critic/train."""
    sound = {
        "run_id": world.run_id,
        "generation": 1,
        "experience": -1,
        "rates": rates_to_msg(Settings(n_evo=5)),
    }
    faults = [
        *ints("generation", -2, -FAR, FAR, 2**62),
        *ints("experience", -3, -FAR, 1, FAR, -(2**62), 2**62),
        *(("rates", bad_rates(fault)) for fault in BAD_RATES),
    ]
    return Target(names.TRAIN, sound, tuple(faults), generations=("generation", "experience"))


def store_target(world: World) -> Target:
    """Return critic/store_experience."""
    b = world.settings.batch_size
    sound = {"run_id": world.run_id, "generation": 0, "fitness": numbers("d", b)}
    faults = [
        *ints("generation", -3, -FAR, FAR, 2**62),
        *of_length("fitness", "d", b),
        *not_finite("fitness", "d", b),
    ]
    return Target(names.STORE_EXPERIENCE, sound, tuple(faults))


def transitions_target(world: World) -> Target:
    """Return experience/transitions."""
    o, a, d, t = world.spec.observation_dim, world.spec.action_dim, world.spec.descriptor_dim, 20
    sound = {
        "run_id": world.run_id,
        "task": world.settings.task,
        "evaluator": "/stray",
        "generation": 1,
        "evaluation": 0,
        "fitness": 1.0,
        "descriptor": numbers("d", d),
        "steps": t,
        "observation_dim": o,
        "action_dim": a,
        "states": numbers("f", (t + 1) * o),
        "actions": numbers("f", t * a),
        "rewards": numbers("f", t),
        "intended_descriptor": numbers("d", d),
    }
    faults = [
        *ints("generation", -FAR, FAR, 2**62),
        *ints("evaluation", -1, -(2**63), 2**63 - 1),
        *ints("steps", 0, -1, t + 1, world.spec.max_steps + 1, 2**63 - 1),
        *ints("observation_dim", 0, -1, o + 1, 2**63 - 1),
        *ints("action_dim", 0, a + 1),
        ("fitness", float("nan")),
        *of_length("descriptor", "d", d),
        *not_finite("descriptor", "d", d),
        *of_length("states", "f", (t + 1) * o),
        *not_finite("states", "f", (t + 1) * o),
        *of_length("actions", "f", t * a),
        *of_length("rewards", "f", t),
        *not_finite("rewards", "f", t),
        # Empty, it says that there is none.
        *(fault for fault in of_length("intended_descriptor", "d", d) if len(fault[1])),
        *not_finite("intended_descriptor", "d", d),
    ]
    return Target(names.TRANSITIONS, sound, tuple(faults))


def snapshot_target(world: World) -> Target:
    """Return critic/snapshot."""
    s, shape = world.settings, world.shape
    critic = critic_shape(world.spec, s)
    layers = [*critic.sizes, *shape.sizes]
    parameters = critic.parameter_count + shape.parameter_count
    states = s.n_grad * s.transition_batch * world.spec.observation_dim
    sound = {
        "run_id": world.run_id,
        "generation": 1,
        "networks": ["critic", "greedy"],
        "layer_counts": array.array("q", [len(critic.sizes), len(shape.sizes)]),
        "layer_sizes": array.array("q", layers),
        "parameters": numbers("f", parameters),
        "n_batches": 1,
        "n_grad": s.n_grad,
        "batch_size": s.transition_batch,
        "observation_dim": world.spec.observation_dim,
        "states": numbers("f", states),
    }
    faults = [
        *ints("n_batches", 0, -1, 2, 2**62),
        *ints("observation_dim", 0, 1, -1, 2**62),
        *ints("batch_size", 0, 1, -5, 2**62),
        *of_length("parameters", "f", parameters),
        *not_finite("parameters", "f", parameters),
        # Valid, but not in a run that learns a critic and a greedy controller:
        ("networks", ["critic", "center"]),
        ("networks", ["diversity_critic", "greedy"]),
        ("networks", ["greedy", "critic"]),
        ("networks", ["critic", "critic"]),
        ("networks", ["critic"]),
        ("networks", []),
        ("networks", ["critic", "greedy", "center"]),
        *of_length("layer_counts", "q", 2),
        ("layer_counts", array.array("q", [len(layers) + 1, -1])),
        ("layer_counts", array.array("q", [2**62, 2**62])),
        ("layer_counts", array.array("q", [len(layers), 0])),
        *of_length("states", "f", states),
        *not_finite("states", "f", states),
        ("layer_sizes", array.array("q")),
        ("layer_sizes", array.array("q", [2**62] * len(layers))),
        ("layer_sizes", numbers("q", 100_000, 1)),
        ("layer_sizes", array.array("q", [-1, *layers[1:]])),
        ("layer_sizes", array.array("q", layers[:-1])),
    ]
    return Target(names.SNAPSHOT, sound, tuple(faults))


def elites_target(world: World) -> Target:
    """Return archive/elites; the sound one is of a run that has as many cells."""
    p, d = world.shape.parameter_count, world.spec.descriptor_dim
    sound = {
        "run_id": world.run_id,
        "generation": 0,
        "cells": array.array("q", [0, 1]),
        "evaluations": array.array("q", [0, 1]),
        "parameters": numbers("f", 2 * p),
        "descriptors": numbers("d", 2 * d),
    }
    faults = [
        *ints("generation", -FAR, -(2**63)),
        ("cells", array.array("q", [0, -1])),
        ("cells", array.array("q", [0, 2**62])),
        ("cells", array.array("q", [1, 1])),
        *of_length("cells", "q", 2),
        ("evaluations", array.array("q", [0, -1])),
        ("evaluations", array.array("q", [1, 1])),
        *of_length("evaluations", "q", 2),
        *of_length("parameters", "f", 2 * p),
        *not_finite("parameters", "f", 2 * p),
        *of_length("descriptors", "d", 2 * d),
        *not_finite("descriptors", "d", 2 * d),
    ]
    return Target(names.ELITES, sound, tuple(faults))


def evaluate_target(world: World, evaluator: str) -> Target:
    """Return an evaluator's evaluate, which is for any run of its task: the trainer tells apart what came of it."""
    p, d = world.shape.parameter_count, world.spec.descriptor_dim
    sound = {
        "run_id": FOREIGN,
        "task": world.settings.task,
        "generation": 0,
        "evaluations": array.array("q", [0]),
        "layer_sizes": array.array("q", world.shape.sizes),
        "parameters": numbers("f", p),
    }
    sizes = [(), (1,), (0, 0), (2**62, 2**62), (-1, 5), (*world.shape.sizes, 3)]
    faults = [
        *((("task", text)) for text in STRINGS),
        ("evaluations", array.array("q")),
        ("evaluations", array.array("q", [-1])),
        *ints("seed", -1, -(2**63)),
        *ints("generation", -FAR),
        *((("layer_sizes", array.array("q", s))) for s in sizes),
        ("layer_sizes", numbers("q", 100_000, 22)),
        *of_length("parameters", "f", p),
        *not_finite("parameters", "f", p),
        *((("exploration_sigma", x)) for x in (-0.1, 10.1, math.nan, math.inf)),
        *((("exploration_correlation", x)) for x in (-0.1, 1.0, math.nan, math.inf)),
        # Empty or NaN, it says that there is none.
        *(fault for fault in of_length("intended_descriptors", "d", d) if len(fault[1])),
        ("intended_descriptors", array.array("d", [math.inf] * d)),
    ]
    return Target(
        f"{evaluator}/evaluate", sound, tuple(faults), owned=False, harmless=True, generations=()
    )
