"""Pure conversions between messages and the core's types.

Messages carry flat arrays with their dimensions; reading checks that the two agree, so that a malformed message is
refused with a reason before it reaches the core.
"""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from dataclasses import fields
from itertools import chain
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from pga_me_msgs.msg import Behavior, Controller, CriticSnapshot, Rates, Transitions
from pga_me_msgs.msg import Metrics as MetricsMsg
from sensor_msgs.msg import Image

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.archive.corrected import CorrectedMetrics
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.snapshot import Network, Snapshot
from pga_me_ros.core.storage.npz import LAYOUT
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import RequestError, SettingsError
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec

MOST_LAYERS = 100
"""Maximum layers of a network in a message; a list of millions would become Python numbers before its refusal."""

PURE_NUMBER = "1"
"""Unit of a pure number in messages; a task's spec leaves it empty."""


def flat(values: Any, typecode: str) -> array.array[Any]:
    """Return numbers as the array type that rclpy copies in one piece.

    Args:
        values: Array or sequence of any shape.
        typecode: ``'f'``, ``'d'`` or ``'q'`` for float32, float64 or int64 fields.
    """
    out = array.array(typecode)
    out.frombytes(np.ascontiguousarray(values, dtype=typecode).view(np.uint8).data)
    return out


def shaped(data: Any, shape: tuple[int, ...], dtype: Any, name: str) -> NDArray[Any]:
    """Return a flat message field as an array of the given shape, without a copy where possible.

    Raises:
        RequestError: A dimension is negative, or the field has another number of entries.
    """
    # Counted before copying: a message may hold any number of entries.
    if min(shape) < 0 or len(data) != math.prod(shape):
        raise RequestError(
            f"Field '{name}' has {len(data)} entries, but its dimensions {shape} need "
            f"{math.prod(shape)}."
        )
    values: NDArray[Any] = np.asarray(data, dtype=dtype)
    return values.reshape(shape)


def layers_from_msg(sizes: Sequence[int], name: str) -> MlpShape:
    """Return the layers of a network from a message's field.

    Raises:
        RequestError: There are more than `MOST_LAYERS` layers.
    """
    if len(sizes) > MOST_LAYERS:
        raise RequestError(f"Field '{name}' has {len(sizes)} entries; expected one per layer.")
    return MlpShape(tuple(int(n) for n in sizes))


def finite(values: Any, name: str) -> Any:
    """Return an array or a number unless it holds NaN or infinity.

    Raises:
        RequestError: The values hold NaN or infinity.
    """
    if not np.isfinite(values).all():
        raise RequestError(
            f"Field '{name}' holds NaN or infinity; only finite numbers are accepted."
        )
    return values


def rates_to_msg(settings: Settings) -> Rates:
    """Return the rates in force as a message."""
    return Rates(**settings.rates)


def with_rates(settings: Settings, msg: Rates) -> Settings:
    """Return settings with the rates of a request, checked.

    Raises:
        RequestError: A rate is out of its range.
    """
    try:
        return settings.with_rates({name: getattr(msg, name) for name in RATES})
    except SettingsError as error:
        raise RequestError(str(error)) from None


def episode_to_msg(episode: Episode, **ids: Any) -> Transitions:
    """Return an episode as a message.

    Args:
        episode: The episode.
        ids: run_id, task, evaluator, generation and evaluation.
    """
    msg = Transitions(**ids)
    msg.fitness = float(episode.fitness)
    msg.descriptor = flat(episode.descriptor, "d")
    msg.steps = episode.length
    msg.observation_dim = episode.states.shape[1]
    msg.action_dim = episode.actions.shape[1]
    msg.states = flat(episode.states, "f")
    msg.actions = flat(episode.actions, "f")
    msg.rewards = flat(episode.rewards, "f")
    msg.terminated = bool(episode.terminated)
    if episode.intended is not None:
        msg.intended_descriptor = flat(episode.intended, "d")
    return msg


def episode_from_msg(msg: Transitions, spec: TaskSpec) -> Episode:
    """Return the episode of a message.

    Raises:
        RequestError: Its dimensions do not fit its arrays or the task, or a number is not finite.
    """
    dims = (spec.observation_dim, spec.action_dim, spec.descriptor_dim)
    theirs = (msg.observation_dim, msg.action_dim, len(msg.descriptor))
    if theirs != dims:
        raise RequestError(
            f"Episode {msg.evaluation} has (observation, action, descriptor) dimensions {theirs}, "
            f"task '{spec.name}' has {dims}."
        )
    if not 1 <= msg.steps <= spec.max_steps:
        raise RequestError(
            f"Episode {msg.evaluation} has {msg.steps} steps; expected 1 to {spec.max_steps}."
        )
    steps = msg.steps
    return Episode(
        states=finite(shaped(msg.states, (steps + 1, dims[0]), np.float32, "states"), "states"),
        actions=finite(shaped(msg.actions, (steps, dims[1]), np.float32, "actions"), "actions"),
        rewards=finite(shaped(msg.rewards, (steps,), np.float32, "rewards"), "rewards"),
        fitness=float(finite(np.float64(msg.fitness), "fitness")),
        descriptor=finite(np.array(msg.descriptor, np.float64), "descriptor"),
        terminated=msg.terminated,
        intended=_intended_from_msg(msg, spec),
    )


def _intended_from_msg(msg: Transitions, spec: TaskSpec) -> Float64Array | None:
    """Return the intended descriptor of an episode's message, None for none; see `episode_from_msg`."""
    if not len(msg.intended_descriptor):
        return None
    values = shaped(
        msg.intended_descriptor, (spec.descriptor_dim,), np.float64, "intended_descriptor"
    )
    return finite(values, "intended_descriptor")


def snapshot_to_msg(snapshot: Snapshot, run_id: str) -> CriticSnapshot:
    """Return a critic snapshot as a message."""
    msg = CriticSnapshot(run_id=run_id, generation=snapshot.generation, version=snapshot.version)
    msg.networks = list(snapshot.networks)
    layers = [shape.sizes for shape, _ in snapshot.networks.values()]
    msg.layer_counts = flat([len(sizes) for sizes in layers], "q")
    msg.layer_sizes = flat(list(chain.from_iterable(layers)), "q")
    parameters = [parameters for _, parameters in snapshot.networks.values()]
    msg.parameters = flat(np.concatenate(parameters) if parameters else (), "f")
    msg.n_batches, msg.n_grad, msg.batch_size, msg.observation_dim = snapshot.states.shape
    msg.states = flat(snapshot.states, "f")
    msg.transitions = snapshot.transitions
    msg.critic_loss, msg.mean_q = snapshot.critic_loss, snapshot.mean_q
    return msg


def snapshot_from_msg(msg: CriticSnapshot) -> Snapshot:
    """Return the snapshot of a message.

    Raises:
        RequestError: Its dimensions do not fit its arrays, two networks share a name, or a state is not finite.
        NetworkError: A network's parameters do not fit its layers or are not finite.
    """
    states_shape = (msg.n_batches, msg.n_grad, msg.batch_size, msg.observation_dim)
    return Snapshot(
        generation=msg.generation,
        version=msg.version,
        networks=_networks(msg),
        states=finite(shaped(msg.states, states_shape, np.float32, "states"), "states"),
        transitions=msg.transitions,
        critic_loss=msg.critic_loss,
        mean_q=msg.mean_q,
    )


def _networks(msg: CriticSnapshot) -> dict[str, Network]:
    """Return the networks of a snapshot's message, by name; see `snapshot_from_msg`."""
    names, counts = msg.networks, msg.layer_counts
    if len(names) != len(counts) or len(names) != len(set(names)):
        raise RequestError(
            f"Fields 'networks' and 'layer_counts' have {len(names)} and {len(counts)} entries, "
            f"{len(set(names))} names differ; expected one of each per network, and different names."
        )
    if sum(counts) != len(msg.layer_sizes) or min(counts, default=0) < 0:
        raise RequestError(
            f"Field 'layer_sizes' has {len(msg.layer_sizes)} entries, but 'layer_counts' adds up to {sum(counts)}."
        )
    parameters = np.array(msg.parameters, np.float32)
    networks: dict[str, Network] = {}
    layer = first = 0
    for name, count in zip(names, counts, strict=True):
        shape = layers_from_msg(msg.layer_sizes[layer : layer + count], "layer_sizes")
        own = parameters[first : first + shape.parameter_count].copy()
        shape.check(own)
        networks[name] = (shape, own)
        layer, first = layer + count, first + shape.parameter_count
    if first != len(parameters):
        raise RequestError(
            f"Field 'parameters' has {len(parameters)} entries, but the layers take {first}."
        )
    return networks


def metrics_to_msg(
    metrics: Metrics | None,
    info: RunInfo,
    cells: int,
    corrected: CorrectedMetrics | None = None,
) -> MetricsMsg:
    """Return metrics as a message without a stamp.

    Args:
        metrics: Metrics of the last generation; None stands for an archive without generations.
        info: Description of the run.
        cells: Cells of the archive.
        corrected: Measures of the archive by re-evaluations, None while they are not known.
    """
    msg = MetricsMsg(run_id=info.run_id, task=info.task["name"], cells=cells, generation=-1)
    msg.max_fitness = msg.mean_fitness = math.nan
    for f in fields(CorrectedMetrics):
        if hasattr(msg, name := f"corrected_{f.name}"):
            unknown = 0 if isinstance(getattr(msg, name), int) else math.nan
            setattr(msg, name, getattr(corrected, f.name) if corrected else unknown)
    if metrics:
        msg.generation = metrics.generation
        msg.evaluations = metrics.evaluations
        msg.coverage = metrics.coverage
        msg.qd_score = metrics.qd_score
        msg.max_fitness = metrics.max_fitness
        msg.mean_fitness = metrics.mean_fitness
        msg.new_elites = sum(metrics.new_elites)
        msg.improved_elites = sum(metrics.improved_elites)
        msg.steps = metrics.steps
    return msg


def image_to_msg(rgb: NDArray[np.uint8], stamp: Time) -> Image:
    """Return a (height, width, 3) uint8 picture as an ``rgb8`` image."""
    msg = Image(height=rgb.shape[0], width=rgb.shape[1], encoding="rgb8", step=3 * rgb.shape[1])
    msg.header.stamp = stamp
    msg.data = array.array("B", np.ascontiguousarray(rgb).tobytes())
    return msg


def behavior_to_msg(
    elite: Elite, known: Statistics | None = None, *, by_mean: bool = False
) -> Behavior:
    """Return an elite as a message, without its controller.

    Args:
        elite: The elite.
        known: What re-evaluations say of it and others, None for nothing.
        by_mean: Whether it was judged by their means.
    """
    parents = [p for p in (elite.parent1, elite.parent2) if p >= 0]
    msg = Behavior(
        cell=int(elite.cell),
        descriptor=flat(elite.descriptor, "d"),
        fitness=float(elite.fitness),
        evaluation=int(elite.evaluation),
        generation=int(elite.generation),
        made_by=Operator(elite.operator).label,
        parents=parents,
        steps=int(elite.steps),
        terminated=bool(elite.terminated),
        mean_fitness=math.nan,
        fitness_spread=math.nan,
        fall_share=math.nan,
        by_mean=by_mean,
    )
    repeats = 0 if known is None else int(known.repeats[elite.cell])
    if known is not None and repeats:
        msg.repeats = repeats
        msg.mean_fitness = float(known.mean_fitness[elite.cell])
        msg.mean_descriptor = flat(known.mean_descriptor[elite.cell], "d")
        msg.fall_share = float(known.fall_share[elite.cell])
        if repeats > 1:
            msg.fitness_spread = float(known.fitness_spread[elite.cell])
            msg.descriptor_spread = flat(known.descriptor_spread[elite.cell], "d")
    return msg


def controller_to_msg(parameters: Float32Array, shape: MlpShape, spec: TaskSpec) -> Controller:
    """Return a controller as a self-contained message."""
    msg = Controller(task=spec.name, layout=LAYOUT, control_period=float(spec.control_period))
    msg.layer_sizes = flat(shape.sizes, "q")
    msg.activations = ["relu"] * (len(shape.sizes) - 2) + ["tanh"]
    msg.parameters = flat(parameters, "f")
    for kind in ("observation", "action"):
        setattr(msg, f"{kind}_names", list(getattr(spec, f"{kind}_names")))
        setattr(msg, f"{kind}_units", [u or PURE_NUMBER for u in getattr(spec, f"{kind}_units")])
    for kind in ("observation", "action", "joint"):  # empty if unknown
        setattr(msg, f"{kind}_low", flat(getattr(spec, f"{kind}_low"), "d"))
        setattr(msg, f"{kind}_high", flat(getattr(spec, f"{kind}_high"), "d"))
    msg.joint_names, msg.descriptor_names = list(spec.joint_names), list(spec.descriptor_names)
    return msg
