"""Stored runs in scripts and notebooks: read, run and draw their behaviors, and store your own search."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints
from pga_me_ros.core.runs.stored_actor import StoredActor
from pga_me_ros.core.storage import stored_run
from pga_me_ros.core.storage.metrics_file import METRICS_FILE, MetricsFile
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.core.storage.stored_run import StoredBehavior
from pga_me_ros.core.storage.whole_run import store_whole_run
from pga_me_ros.dependencies import missing
from pga_me_ros.errors import RequestError
from pga_me_ros.paths import user_path
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import Episode, rollout

if TYPE_CHECKING:
    import pandas as pd

    from pga_me_ros.core.search import Search

__all__ = ["StoredBehavior", "StoredRun", "save_run"]

_COLUMNS = ("cell", "evaluation", "generation", "made_by", "steps", "terminated", "fitness")
_MEANS = ("repeats", "mean_fitness", "fitness_spread", "fall_share")


class StoredRun(stored_run.StoredRun):
    """A stored run, for scripts and notebooks; made by `StoredRun.load`."""

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table with one row per elite, without parameters; columns as in ``export --to csv``.

        Missing parents are -1; missing means and spreads over re-evaluations are NaN.

        Raises:
            MissingDependencyError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise missing("pandas", "to_dataframe") from None
        arrays, names = self.arrays(), self.spec.descriptor_names
        columns: dict[str, Any] = {name: arrays[name] for name in _COLUMNS}
        columns |= {f"parent{k + 1}": arrays["parents"][:, k] for k in range(2)}
        columns |= {name: arrays["descriptor"][:, k] for k, name in enumerate(names)}
        if "repeats" in arrays:
            columns |= {name: arrays[name] for name in _MEANS}
            for kind, key in (("mean", "mean_descriptor"), ("spread", "descriptor_spread")):
                columns |= {f"{kind}:{name}": arrays[key][:, k] for k, name in enumerate(names)}
        return pd.DataFrame(columns)

    def actor(self) -> ConditionedActor:
        """Return the actor of a run of DCRL-MAP-Elites: one network that is asked for a descriptor at each step.

        It needs NumPy alone. `ConditionedActor.at` makes a plain controller of it.

        Raises:
            RequestError: The algorithm of the run learns no such actor, no training has ended yet, or the repertoire
                was copied without it.
            StorageError: It is damaged.

        Warns:
            UserWarning: The newest checkpoint is damaged, so this is an older actor.
        """
        stored = StoredActor.of(self)
        if stored.note:
            warnings.warn(stored.note, stacklevel=2)
        return stored.actor

    def rollout(
        self, behavior: StoredBehavior, seed: int | None = None, task: Task | None = None
    ) -> Episode:
        """Run a behavior in the simulator for one episode.

        Args:
            behavior: A behavior of this run.
            seed: Seed of the initial pose. None repeats the evaluation in which the behavior was found: the same
                versions of the libraries give the same episode, bit for bit.
            task: A task to run it in, as returned by `make_task`; None makes one for this episode.

        Raises:
            TaskError: The task of the run cannot be loaded.
        """
        own = task or make_task(self.settings.task, self.settings.randomization)
        try:
            if seed is not None:
                return rollout(own, behavior.controller, np.random.default_rng(seed))
            act = as_evaluated(self.settings, behavior.controller, behavior.evaluation)
            return rollout(own, act, evaluation_rng(self.settings.seed, behavior.evaluation))
        finally:
            if task is None:
                own.close()

    def save_gif(
        self,
        behavior: StoredBehavior,
        path: str | Path,
        *,
        seconds: float = 10.0,
        size: tuple[int, int] = (360, 270),
    ) -> Path:
        """Draw the evaluation in which a behavior was found as an animated GIF, like the program ``render``.

        Args:
            behavior: A behavior of this run.
            path: File to write.
            seconds: Maximum seconds to show.
            size: Width and height, pixels.

        Returns:
            The file.

        Raises:
            PgaError: Pillow is not installed, the task cannot be drawn, or a number is out of bounds.
            StorageError: The file cannot be written.
        """
        from pga_me_ros.render.behavior_gif import GifOptions, draw_gif

        task = make_task(self.settings.task, self.settings.randomization)
        try:
            options = GifOptions(seconds=seconds, size=size)
            draw_gif(task, self.settings, behavior, user_path(path), options)
        finally:
            task.close()
        return user_path(path)


def save_run(path: str | Path, search: Search) -> StoredRun:
    """Store a search, so that it can be read, served, exported, rendered and reported on like any other run.

    Learning curves are complete, apart from the worst and the best elite of earlier generations. Experience is not
    stored, so only an algorithm that learns nothing can go on from the folder. An actor that is conditioned on
    descriptors is stored with its critics (`StoredRun.actor`). Rates are stored as they are now.

    Args:
        path: Folder for the run.
        search: The search, after at least one generation.

    Returns:
        The run, read back.

    Raises:
        RequestError: The search has no generation yet.
        StorageError: The folder already holds a run, or cannot be written.
    """
    if not search.metrics:
        raise RequestError("The search has no generation yet; call run_generation first.")
    file = user_path(path) / stored_run.REPERTOIRE
    info = RunInfo.of_new_run(search.spec, search.settings)
    rates, depth = search.settings.rates, search.depth
    store_whole_run(file, info, search.archive, search.metrics, rates, depth=depth)
    if search.trained and algorithm_of(search.settings).conditioned:
        CriticCheckpoints(file.parent).save(*search.trained, search.learner.state())
    run = StoredRun.load(file)
    MetricsFile(file.with_name(METRICS_FILE)).rebuild(run.generations, run.reevaluations.measured)
    return run
