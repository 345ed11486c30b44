"""TD3 with an archive compared with textbook TD3 (Fujimoto et al. 2018, Alg. 1) in float64.

The textbook acts and learns by itself: it shares only initial networks, random controllers, noise and the indices of
each batch's transitions with the run.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch
from lane_task import Lane, settings_of
from test_critic_oracle import reference

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.gradients.device import torch_threads
from pga_me_ros.core.learning.td3_step import TransitionBatch
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.search import Search

S = settings_of(
    "td3",
    batch_size=3,
    random_init=6,
    evaluations=18,
    discount=0.9,
    target_period=5,  # does not divide a generation's steps, which reveals counting from 0 in each
    critic_learning_rate=2e-3,
    greedy_learning_rate=2e-3,
    target_rate=0.05,
)
OBS, ACT = Lane.spec.observation_dim, Lane.spec.action_dim


class Textbook:
    """A TD3 that acts and learns by itself; one training step per call of `train`."""

    def __init__(self, search):
        self._td3 = reference(search.learner.state(), search.learner._trainer, S)
        self.steps = 0

    def act(self, state):
        with torch.no_grad():
            return self._td3.greedy(torch.from_numpy(state.astype(np.float64))).numpy()

    def train(self, transitions, normal):
        self.steps += 1
        self._td3.step(self.steps, transitions, normal)


def episode(act, evaluation, sigma):
    """Yield (s, a, r, s', not_done) of an episode with exploration."""
    task, noise = Lane(), generator(S.seed, Purpose.EXPLORATION, 0, evaluation)
    state = task.reset(evaluation_rng(S.seed, evaluation))
    for step in range(1, Lane.spec.max_steps + 1):
        action = act(state)
        if sigma:
            action = np.clip(action + sigma * noise.standard_normal(ACT, np.float32), -1, 1)
        action = action.astype(np.float32)
        after, reward, fell = task.step(action)
        ended = fell and step < Lane.spec.max_steps
        yield state, action, reward, after, 0.0 if ended else 1.0
        if fell:
            return
        state = after


def batches(replay, generation, steps):
    """Yield the run's batches in float64."""
    rng = generator(S.seed, Purpose.CRITIC_TRAINING, generation)
    n = S.transition_batch
    for _ in range(steps):
        rows = [replay[i] for i in rng.integers(0, len(replay), n)]
        s, a, r, s2, not_done = (np.array(c, np.float64) for c in zip(*rows, strict=True))
        normal = rng.standard_normal((n, ACT), np.float32).astype(np.float64)
        columns = (s, a, r[:, None], s2, not_done[:, None])
        yield TransitionBatch(*map(torch.from_numpy, columns)), torch.from_numpy(normal)


@pytest.fixture(autouse=True)
def one_thread():
    """Use one thread: these networks are too small to gain from more."""
    with torch_threads(1):
        yield


def test_the_actor_of_every_generation_equals_the_textbooks():
    search = Search(Lane.spec, S)
    textbook = Textbook(search)
    start = textbook.act(np.zeros(2, np.float32))
    replay, newest, task = [], 0, Lane()
    for t in range(S.generations):
        if t >= S.init_generations:
            for batch in batches(replay, t, newest):
                textbook.train(*batch)
        asked = search.ask()
        newest = len(replay)
        for k, parameters in zip(asked.evaluations, asked.parameters, strict=True):
            starting_up = asked.operators[0] == Operator.RANDOM
            act = MlpController(search.shape, parameters) if starting_up else textbook.act
            replay += episode(act, k, 0.0 if starting_up else S.exploration_sigma)
        newest = len(replay) - newest
        if t >= S.init_generations:
            ours = MlpController(search.shape, asked.parameters[0])
            for state in ([0, 0], [0.5, -0.1], [-1, 0.05]):
                state = np.float32(state)
                np.testing.assert_allclose(ours(state), textbook.act(state), rtol=0, atol=2e-3)
        assert search.run_generation(task).steps == newest
    seen = search.metrics[-2].total_steps - search.metrics[0].steps
    assert textbook.steps == search.learner.version == seen
    assert np.abs(textbook.act(np.zeros(2, np.float32)) - start).max() > 0.1
