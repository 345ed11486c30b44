"""Exploration noise: its distribution, and that it depends on the evaluation."""

from __future__ import annotations

import numpy as np
import pytest
from lane_task import SETTINGS, Lane, settings_of

from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.exploration import Noise, exploring
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import random_parameters
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.tasks.rollout import rollout

TD3 = settings_of("td3", exploration_sigma=0.3)
SHAPE = controller_shape(Lane.spec, TD3)
CONTROLLER = MlpController(SHAPE, random_parameters(SHAPE, np.random.default_rng(0)))
FIRST = TD3.init_generations * TD3.batch_size
"""First evaluation that explores."""


def episode(evaluation: int, settings=TD3):
    act = as_evaluated(settings, CONTROLLER, evaluation)
    return rollout(Lane(), act, evaluation_rng(settings.seed, evaluation))


def test_recorded_actions_are_the_controllers_plus_noise_clipped():
    found = episode(FIRST)
    rng = generator(TD3.seed, Purpose.EXPLORATION, 0, FIRST)
    plain = np.stack([CONTROLLER(s) for s in found.states[:-1]])
    noise = np.stack([rng.standard_normal(2, np.float32) for _ in plain])
    np.testing.assert_array_equal(found.actions, np.clip(plain + np.float32(0.3) * noise, -1, 1))
    assert found.actions.dtype == np.float32


def test_actions_stay_within_their_limits():
    act = exploring(lambda _: np.float32([1.0, -1.0]), Noise(5.0), 0, 0)
    actions = np.stack([act(np.zeros(2, np.float32)) for _ in range(200)])
    assert (actions.min(), actions.max()) == (-1.0, 1.0)


def test_noise_has_the_given_standard_deviation():
    act = exploring(lambda _: np.zeros(2, np.float32), Noise(0.1), 0, 0)
    actions = np.stack([act(np.zeros(2, np.float32)) for _ in range(4000)])
    assert actions.std() == pytest.approx(0.1, rel=0.03)
    assert abs(actions.mean()) < 0.005


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_noise_has_the_given_correlation_and_the_same_deviation_at_every_step(correlation):
    episodes = []
    for k in range(200):
        act = exploring(lambda _: np.zeros(2, np.float32), Noise(0.1, correlation), 0, k)
        episodes.append([act(np.zeros(2, np.float32)) for _ in range(50)])
    noise = np.stack(episodes)  # (episode, step, entry)
    assert noise.dtype == np.float32
    for step in (0, 1, 49):
        assert noise[:, step].std() == pytest.approx(0.1, rel=0.12)
    for lag in (1, 2):
        found = (noise[:, lag:] * noise[:, :-lag]).mean() / noise.var()
        assert found == pytest.approx(correlation**lag, abs=0.03)
    assert abs((noise[:, :, 0] * noise[:, :, 1]).mean() / noise.var()) < 0.1


def test_correlated_noise_is_that_of_the_formula():
    settings = TD3.replace(exploration_correlation=0.8)
    found = episode(FIRST, settings)
    rng = generator(TD3.seed, Purpose.EXPLORATION, 0, FIRST)
    noise = []
    for _ in found.actions:
        drawn = rng.standard_normal(2, np.float32).astype(float)
        noise.append(0.8 * noise[-1] + 0.6 * drawn if noise else drawn)
    plain = np.stack([CONTROLLER(s) for s in found.states[:-1]])
    np.testing.assert_allclose(
        found.actions, np.clip(plain + 0.3 * np.stack(noise), -1, 1), atol=1e-5
    )


@pytest.mark.parametrize("settings", [TD3, TD3.replace(exploration_correlation=0.9)])
def test_a_repeated_evaluation_has_the_same_bits(settings):
    one, again = episode(FIRST + 3, settings), episode(FIRST + 3, settings)
    assert one.states.tobytes() == again.states.tobytes()
    assert one.actions.tobytes() == again.actions.tobytes()


def test_no_two_evaluations_share_their_noise():
    rngs = [exploring(lambda _: np.zeros(2, np.float32), Noise(0.1), 0, k) for k in range(2)]
    assert not np.array_equal(*(act(np.zeros(2, np.float32)) for act in rngs))


@pytest.mark.parametrize(
    ("settings", "evaluation"),
    [(TD3, FIRST - 1), (TD3.replace(exploration_sigma=0.0), FIRST), (SETTINGS, FIRST)],
    ids=["start-up", "no-noise", "another-system"],
)
def test_without_exploration_the_controllers_actions_are_unchanged(settings, evaluation):
    assert as_evaluated(settings, CONTROLLER, evaluation) is CONTROLLER
