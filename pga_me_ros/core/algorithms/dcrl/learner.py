"""The learner of DCRL-MAP-Elites: the critics and the actor of `CriticLearner`, conditioned on descriptors."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from pga_me_ros.core.algorithms.dcrl.similarity import similarity
from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.networks.conditioned import ConditionedDimensions, scaled
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import ACTOR, CRITIC, GREEDY, Snapshot
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


class DcrlLearner(CriticLearner):
    """TD3 on observations joined with d', the descriptor that the episode was meant to achieve.

    A transition (s, a, r, s') of an episode that achieved d is stored as ((s, d'), a, S(d, d') r, (s', d')). Training
    on these trains Q(s, a | d') and pi(s | d'); the farther an episode missed d', the less its rewards count.
    `textbook_step.TextbookDcrl` is the same step written out; a test compares the two.

    Args:
        spec: Task.
        settings: Settings of the run.
        workers: Threads of critic training.

    Raises:
        SettingsError: The device cannot be used here.
        PgaError: The machine cannot reserve memory for `replay_size` transitions.
    """

    def __init__(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> None:
        super().__init__(spec, settings, workers, ConditionedDimensions.of(spec))

    def add(self, generation: int, episodes: Iterable[Episode]) -> None:
        """Add one generation's experience, in evaluation order.

        Without an intended descriptor (GA and random controllers), the achieved one is taken as intended.

        Args:
            generation: Number of the generation, `newest` + 1.
            episodes: All its episodes.

        Raises:
            PgaError: An episode is of another robot.
        """
        super().add(generation, (self._conditioned(episode) for episode in episodes))

    def train(self, rates: Settings, generation: int) -> Snapshot:
        """Train as `CriticLearner` does; the snapshot has an actor in place of a greedy controller."""
        snapshot = super().train(rates, generation)
        networks = {CRITIC: snapshot.network(CRITIC), ACTOR: snapshot.network(GREEDY)}
        states = snapshot.states[
            ..., : self._spec.observation_dim
        ]  # each PG offspring brings its own descriptor
        return dataclasses.replace(snapshot, networks=networks, states=np.ascontiguousarray(states))

    def _conditioned(self, episode: Episode) -> Episode:
        """Return an episode with the intended descriptor in its states and rewards scaled by the similarity."""
        achieved = scaled(episode.descriptor, self._spec)
        aim = achieved if episode.intended is None else scaled(episode.intended, self._spec)
        counts = similarity(achieved, aim, self._settings.similarity_length)
        aims = np.tile(aim.astype(np.float32), (len(episode.states), 1))
        return dataclasses.replace(
            episode,
            states=np.concatenate([episode.states, aims], axis=1),
            rewards=(episode.rewards * counts).astype(np.float32),
        )
