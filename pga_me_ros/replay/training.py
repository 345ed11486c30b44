"""Trains critics on recorded experience."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.algorithms.learners import make_learner
from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.learning.learner import Learner
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import GREEDY, Snapshot
from pga_me_ros.core.storage.files import make_folder, save_bytes
from pga_me_ros.core.storage.npz import FORMAT, LAYOUT, save_arrays
from pga_me_ros.core.storage.run_info import library_versions
from pga_me_ros.errors import StorageError
from pga_me_ros.recording.episodes import RecordedRun
from pga_me_ros.tasks.spec import TaskSpec

STATISTICS = "statistics.json"
GREEDY_FILE = "greedy.npz"

_ABOUT = ("observation_names", "observation_units", "action_names", "action_units")


def train_critics(
    recorded: RecordedRun, spec: TaskSpec, settings: Settings, out: Path
) -> dict[str, Any]:
    """Train critics and a greedy controller for n_crit steps on a recording, as a run does (Alg. 4).

    The outcome depends only on the episodes, the settings and the library versions, bit for bit: episodes enter the
    replay buffer in evaluation order, and all draws are those of the generation after the last recorded one.

    Args:
        recorded: The recording; its newest `replay_size` transitions count.
        spec: Its task.
        settings: Seed, layers, rates and number of steps.
        out: New or empty folder: the critics, and an actor that is conditioned on descriptors, as a run's checkpoint; a
            greedy controller as a file that ``start_from`` takes; and what is returned.

    Returns:
        What was trained on what, and with what outcome, as JSON can hold it.

    Raises:
        StorageError: The recording is damaged, or the folder is not empty or cannot be written.
        NetworkError: The training diverged.
        SettingsError: The device cannot be used here.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise StorageError(
            f"'{out}' exists already and is not an empty folder; give another --out."
        )
    make_folder(out)
    conditioned = algorithm_of(settings).conditioned
    learner: Learner = (make_learner if conditioned else CriticLearner)(spec, settings)
    heads = recorded.newest(settings.replay_size)
    for generation, episodes in recorded.episodes(heads, spec):
        learner.add(generation, episodes.values())
    order = TrainingOrder.of(learner.newest + 1, learner.newest, settings)
    snapshot = learner.train(settings, order.generation)
    CriticCheckpoints(out).save(order, snapshot, learner.state())
    if (
        not conditioned
    ):  # an actor that is asked for a descriptor is no controller that a run could start from
        save_arrays(out / GREEDY_FILE, _controller(snapshot, spec))
    statistics = {
        "run_id": recorded.run_id,
        "task": spec.name,
        "episodes": len(heads),
        "evaluations": [heads[0].evaluation, heads[-1].evaluation],
        "missing": len(recorded.missing),
        "transitions": snapshot.transitions,
        "steps": settings.n_crit,
        "critic_loss": snapshot.critic_loss,
        "mean_q": snapshot.mean_q,
        "settings": settings.to_dict(),
        "versions": library_versions(),
    }
    save_bytes(out / STATISTICS, json.dumps(statistics, indent=2).encode() + b"\n")
    return statistics


def _controller(snapshot: Snapshot, spec: TaskSpec) -> dict[str, np.ndarray]:
    """Return the greedy controller in the format of an exported repertoire, without what is unknown of it."""
    shape, parameters = snapshot.network(GREEDY)
    sizes = shape.sizes
    about = spec.to_json()
    return {
        "format": np.array(FORMAT),
        "task": np.array(spec.name),
        "parameters": parameters[None],
        "layer_sizes": np.array(sizes, np.int64),
        "activations": np.array(["relu"] * (len(sizes) - 2) + ["tanh"]),
        "layout": np.array(LAYOUT),
        **{name: np.array(about[name]) for name in _ABOUT},
    }
