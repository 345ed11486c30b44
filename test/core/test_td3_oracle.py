"""TD3 with an archive beside it against TD3 as a textbook writes it (Fujimoto et al. 2018, Alg. 1), in float64.

The textbook acts and learns by itself: only initial networks, random controllers, noise and the numbers of the
transitions of each batch are drawn as the run draws them.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from lane_task import SETTINGS, Lane
from test_critic_oracle import torch_module

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.policy import Controller
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.schedule import evaluation_rng
from pga_me_ros.core.search import Search
from pga_me_ros.core.torch_device import torch_threads

S = SETTINGS.replace(
    algorithm="td3",
    n_evo=50,
    batch_size=3,
    random_init=6,
    evaluations=18,
    discount=0.9,
    target_period=5,  # no divisor of a generation's steps, so that counting anew in each would show
    critic_learning_rate=2e-3,
    greedy_learning_rate=2e-3,
    target_rate=0.05,
)
OBS, ACT = Lane.spec.observation_dim, Lane.spec.action_dim


class TextbookTd3:
    """Actor, twin critics, targets; one training step per call."""

    def __init__(self, state, learner):
        trainer = learner._trainer
        self.actor = torch_module(trainer.greedy_shape, state["greedy"][0], tanh=True)
        self.q1, self.q2 = (torch_module(trainer.critic_shape, f) for f in state["critics"])
        self.actor_target, self.q1_target, self.q2_target = map(
            copy.deepcopy, (self.actor, self.q1, self.q2)
        )
        self.actor_adam = torch.optim.Adam(self.actor.parameters(), S.greedy_learning_rate)
        both = [*self.q1.parameters(), *self.q2.parameters()]
        self.critic_adam = torch.optim.Adam(both, S.critic_learning_rate)
        self.steps = 0

    def act(self, state):
        with torch.no_grad():
            return self.actor(torch.from_numpy(state.astype(np.float64))).numpy()

    def train(self, s, a, r, s2, not_done, noise):
        self.steps += 1
        with torch.no_grad():
            a2 = (self.actor_target(s2) + noise).clamp(-1, 1)
            x2 = torch.cat((s2, a2), 1)
            y = r + not_done * S.discount * torch.min(self.q1_target(x2), self.q2_target(x2))
        mse, x = torch.nn.functional.mse_loss, torch.cat((s, a), 1)
        self.critic_adam.zero_grad()
        (mse(self.q1(x), y) + mse(self.q2(x), y)).backward()
        self.critic_adam.step()
        if self.steps % S.target_period:
            return
        self.actor_adam.zero_grad()
        (-self.q1(torch.cat((s, self.actor(s)), 1)).mean()).backward()
        self.actor_adam.step()
        pairs = (
            (self.actor, self.actor_target),
            (self.q1, self.q1_target),
            (self.q2, self.q2_target),
        )
        with torch.no_grad():
            for online, target in pairs:
                for p, p_target in zip(online.parameters(), target.parameters(), strict=True):
                    p_target.mul_(1 - S.target_rate).add_(S.target_rate * p)


def episode(act, evaluation, sigma):
    """Yield (s, a, r, s', not_done) of an episode whose actor explores."""
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
    """Yield the batches that the run draws, in float64."""
    rng = generator(S.seed, Purpose.CRITIC_TRAINING, generation)
    n = S.transition_batch
    for _ in range(steps):
        rows = [replay[i] for i in rng.integers(0, len(replay), n)]
        s, a, r, s2, not_done = (np.array(c, np.float64) for c in zip(*rows, strict=True))
        noise = S.smoothing_sigma * rng.standard_normal((n, ACT), np.float32)
        noise = np.clip(noise, -S.smoothing_clip, S.smoothing_clip).astype(np.float64)
        yield [torch.from_numpy(x) for x in (s, a, r[:, None], s2, not_done[:, None], noise)]


@pytest.fixture(autouse=True)
def one_thread():
    """Networks as small as these gain nothing by more."""
    with torch_threads(1):
        yield


def test_the_actor_of_every_generation_is_that_of_a_textbook():
    search = Search(Lane.spec, S)
    textbook = TextbookTd3(search.learner.state(), search.learner)
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
            act = Controller(search.shape, parameters) if starting_up else textbook.act
            replay += episode(act, k, 0.0 if starting_up else S.exploration_sigma)
        newest = len(replay) - newest
        if t >= S.init_generations:
            ours = Controller(search.shape, asked.parameters[0])
            for state in ([0, 0], [0.5, -0.1], [-1, 0.05]):
                state = np.float32(state)
                np.testing.assert_allclose(ours(state), textbook.act(state), rtol=0, atol=2e-3)
        assert search.run_generation(task).steps == newest
    seen = search.metrics[-2].total_steps - search.metrics[0].steps
    assert textbook.steps == search.learner.version == seen
    assert np.abs(textbook.act(np.zeros(2, np.float32)) - start).max() > 0.1
