"""Training of DCRL-MAP-Elites against two oracles in float64: a loop that is written out here, and `textbook_step`.

The learner keeps descriptors inside of states and scales rewards when it stores them; the oracles keep them apart, as
the publication does. All draw the same transitions and noise from the generator of (seed, CRITIC_TRAINING, generation):
in each step N indices, then (N, act_dim) normal numbers.
"""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
import torch
from lane_task import Lane

from pga_me_ros.core.algorithms.dcrl.learner import DcrlLearner
from pga_me_ros.core.algorithms.dcrl.similarity import similarity
from pga_me_ros.core.algorithms.dcrl.textbook_step import DescribedBatch, TextbookDcrl
from pga_me_ros.core.gradients.device import torch_threads
from pga_me_ros.core.learning.td3_step import perceptron
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.rollout import Episode

LOW, HIGH = (-2.0, 0.0), (2.0, 0.5)
SPEC = dataclasses.replace(
    Lane.spec,
    observation_names=("a", "b", "c", "d", "e"),
    observation_units=("",) * 5,
    descriptor_names=("one", "two"),
    descriptor_low=LOW,
    descriptor_high=HIGH,
    archive_bins=(4, 4),
)
OBS, ACT, D = 5, 2, 2
# Large rates, so that a wrong step shows far above the rounding of float32.
BASE = Settings(
    algorithm="dcrl_map_elites",
    seed=11,
    n_crit=9,
    target_period=2,
    transition_batch=32,
    controller_hidden=(12, 10),
    critic_hidden=(14, 16),
    critic_learning_rate=3e-3,
    greedy_learning_rate=2e-3,
    target_rate=0.1,
    smoothing_sigma=0.4,
    similarity_length=0.7,
    device="auto",  # a GPU has to give the textbook's result, too
)
CASES = {
    "published": BASE,
    "strict": BASE.replace(similarity_length=0.1),
    "bootstrap": BASE.replace(terminal="bootstrap"),
    "free target action": BASE.replace(
        target_action="free", smoothing_sigma=2.0, smoothing_clip=2.0
    ),
    "every third step": BASE.replace(target_period=3),
}


def lived(n=14):
    """Return episodes of chance; every third one was meant to achieve nothing in particular."""
    rng = np.random.default_rng(5)
    for k in range(n):
        steps = int(rng.integers(1, 12))
        aim = rng.uniform(LOW, HIGH)
        yield Episode(
            states=rng.standard_normal((steps + 1, OBS), np.float32),
            actions=np.tanh(rng.standard_normal((steps, ACT), np.float32)),
            rewards=rng.standard_normal(steps, np.float32),
            fitness=0.0,
            descriptor=np.clip(aim + 0.2 * rng.standard_normal(D), LOW, HIGH),
            terminated=bool(k % 2),
            intended=None if k % 3 == 0 else aim,
        )


def transitions(episodes):
    """Return all transitions in float64 columns, with descriptors scaled by hand."""

    def scale(descriptor):
        return [descriptor[0] / 2.0, 4.0 * descriptor[1] - 1.0]

    rows = []
    for e in episodes:
        aim = e.descriptor if e.intended is None else e.intended
        for t in range(e.length):
            fell = e.terminated and t == e.length - 1 and e.length < SPEC.max_steps
            rows.append(
                (
                    *(
                        e.states[t],
                        e.actions[t],
                        e.states[t + 1],
                        [e.rewards[t]],
                        [float(not fell)],
                    ),
                    *(scale(e.descriptor), scale(aim)),
                )
            )
    return [np.array(column, np.float64) for column in zip(*rows, strict=True)]


def draws(columns, settings, generation):
    """Yield a batch, and standard normal numbers, for each step."""
    rng = generator(settings.seed, Purpose.CRITIC_TRAINING, generation)
    n = settings.transition_batch
    for _ in range(settings.n_crit):
        indices = rng.integers(0, len(columns[0]), n)
        normal = rng.standard_normal((n, ACT), np.float32).astype(np.float64)
        s, a, s2, r, not_done, d, aim = (torch.from_numpy(c[indices]) for c in columns)
        yield DescribedBatch(s, a, r, s2, not_done, d, aim), torch.from_numpy(normal)


def modules(state, learner):
    """Return the actor and the critics that a learner starts from, as torch modules in float64."""
    trainer = learner._trainer
    actor = perceptron(trainer.greedy_shape, state["greedy"][0], tanh=True)
    critics = [perceptron(trainer.critic_shape, flat) for flat in state["critics"]]
    return actor.double(), [critic.double() for critic in critics]


def flat(module):
    return torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy()


def named(critics, critic_targets, actor, actor_target):
    return {
        "critics": np.stack([flat(c) for c in critics]),
        "critic_targets": np.stack([flat(c) for c in critic_targets]),
        "greedy": flat(actor)[None],
        "greedy_target": flat(actor_target)[None],
    }


def by_textbook(state, learner, batches, settings):
    td3 = TextbookDcrl(*modules(state, learner), settings)
    for t, (batch, normal) in enumerate(batches, start=1):
        td3.step(t, batch, normal)
    return named(td3.critics, td3.critic_targets, td3.greedy, td3.greedy_target)


def written_out(state, learner, batches, s):
    """The published training, line by line, with nothing of the package but the networks' start."""
    actor, critics = modules(state, learner)
    actor_target, critic_targets = copy.deepcopy((actor, critics))
    actor_adam = torch.optim.Adam(actor.parameters(), s.greedy_learning_rate)
    critic_adams = [torch.optim.Adam(c.parameters(), s.critic_learning_rate) for c in critics]

    def q(critic, states, actions, descriptors):
        return critic(torch.cat((states, descriptors, actions), 1))

    for t, (b, normal) in enumerate(batches, start=1):
        with torch.no_grad():
            noise = (s.smoothing_sigma * normal).clamp(-s.smoothing_clip, s.smoothing_clip)
            action = actor_target(torch.cat((b.next_states, b.intended), 1)) + noise
            if s.target_action == "clip":
                action = action.clamp(-1, 1)
            worst = torch.minimum(
                *(q(c, b.next_states, action, b.intended) for c in critic_targets)
            )
            if s.terminal == "mask":
                worst = b.not_done * worst
            off = ((b.achieved - b.intended) ** 2).sum(1, keepdim=True).sqrt()
            y = b.rewards * torch.exp(-off / s.similarity_length) + s.discount * worst
        for critic, adam in zip(critics, critic_adams, strict=True):
            adam.zero_grad()
            ((q(critic, b.states, b.actions, b.intended) - y) ** 2).mean().backward()
            adam.step()
        if t % s.target_period == 0:
            actor_adam.zero_grad()
            action = actor(torch.cat((b.states, b.intended), 1))
            (-q(critics[0], b.states, action, b.intended).mean()).backward()
            actor_adam.step()
            with torch.no_grad():
                pairs = zip([*critics, actor], [*critic_targets, actor_target], strict=True)
                for online, target in pairs:
                    for p, p_target in zip(online.parameters(), target.parameters(), strict=True):
                        p_target += s.target_rate * (p - p_target)
    return named(critics, critic_targets, actor, actor_target)


@pytest.fixture(autouse=True)
def one_thread():
    """Networks as small as these gain nothing by more."""
    with torch_threads(1):
        yield


@pytest.mark.parametrize("oracle", [written_out, by_textbook])
@pytest.mark.parametrize("case", CASES)
def test_networks_equal_the_oracle(oracle, case):
    settings, episodes = CASES[case], list(lived())
    learner = DcrlLearner(SPEC, settings)
    learner.add(0, episodes)
    start = learner.state()
    batches = draws(transitions(episodes), settings, generation=7)
    wanted = oracle(start, learner, batches, settings)
    learner.train(settings, 7)
    got = learner.state()
    for name, expected in wanted.items():
        assert np.abs(expected - start[name]).max() > 1e-3, name
        np.testing.assert_allclose(got[name], expected, rtol=0, atol=2e-5, err_msg=name)


@pytest.mark.parametrize(
    ("achieved", "intended", "length", "expected"),
    [
        ([0.3, -0.4], [0.3, -0.4], 0.1, 1.0),
        ([0.0, 0.0], [0.1, 0.0], 0.1, 0.36787944117144233),
        ([0.0, 0.0], [0.03, 0.04], 0.1, 0.6065306597126334),
        ([-1.0, -1.0], [1.0, 1.0], 1.0, 0.05910574656195625),
    ],
)
def test_similarity_is_that_computed_by_hand(achieved, intended, length, expected):
    got = similarity(np.array(achieved), np.array(intended), length)
    assert got == pytest.approx(expected, rel=1e-14)


def test_a_rewards_share_follows_from_the_tasks_own_units():
    """Two tenths of the first range off: 0.4 in scaled units, so e^-4 of the reward at l = 0.1."""
    learner = DcrlLearner(SPEC, BASE.replace(similarity_length=0.1))
    episode = dataclasses.replace(
        next(lived()), descriptor=np.array([0.0, 0.1]), intended=np.array([0.8, 0.1])
    )
    learner.add(0, [episode])
    rows = learner._replay.rows(np.arange(episode.length))
    aims = np.tile(np.float32([0.4, -0.6]), (episode.length, 1))
    np.testing.assert_array_equal(rows[:, :OBS], episode.states[:-1])
    np.testing.assert_allclose(rows[:, OBS : OBS + D], aims, rtol=1e-6)
    np.testing.assert_array_equal(rows[:, OBS + D : OBS + D + ACT], episode.actions)
    after = rows[:, OBS + D + ACT :]
    np.testing.assert_array_equal(after[:, :OBS], episode.states[1:])
    np.testing.assert_allclose(after[:, OBS : OBS + D], aims, rtol=1e-6)
    np.testing.assert_allclose(rows[:, -2], episode.rewards * np.exp(-4.0), rtol=1e-6)
