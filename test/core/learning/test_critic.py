"""Critic training: reproducibility, settings, state, and a problem with a known solution."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from pga_me_ros.core.gradients import threads
from pga_me_ros.core.learning.critic_trainer import BLOCK, CriticTrainer, blocks
from pga_me_ros.core.learning.replay_buffer import ReplayBuffer
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import random_parameters
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.checkpoint import load_checkpoint, save_checkpoint
from pga_me_ros.errors import NetworkError, PgaError, SettingsError, StorageError

SETTINGS = Settings(
    n_crit=10,
    transition_batch=16,
    controller_hidden=(8, 8),
    critic_hidden=(16, 16),
    seed=3,
    device="auto",  # a GPU must pass, too
)


@dataclass(frozen=True)
class Robot:
    observation_dim: int = 4
    action_dim: int = 2


def filled_replay(fell=True, actions=1.0, rewards=1.0):
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(200, 4, 2)
    for steps in (30, 7, 50, 1):
        replay.add_episode(
            rng.standard_normal((steps + 1, 4), np.float32),
            actions * np.tanh(rng.standard_normal((steps, 2), np.float32)),
            rewards * rng.standard_normal(steps, np.float32),
            terminated=fell,
        )
    return replay


def trained(settings=SETTINGS, generations=(1,), replay=None):
    trainer = CriticTrainer(Robot(), settings)
    replay = replay or filled_replay()
    for generation in generations:
        trainer.train(replay, settings, generation)
    return trainer


def assert_same_bits(a, b):
    assert a.state().keys() == b.state().keys()
    for name, array in a.state().items():
        assert array.tobytes() == b.state()[name].tobytes(), name


def test_training_twice_gives_the_same_bits():
    assert_same_bits(trained(generations=(1, 2, 3)), trained(generations=(1, 2, 3)))


def test_paper_sized_networks_train_to_the_same_bits_twice():
    settings = Settings(n_crit=5)
    assert_same_bits(trained(settings), trained(settings))


@pytest.mark.parametrize("idle", [[1], [0], [1, 1, 0]], ids=["always", "never", "now and then"])
def test_second_critic_in_its_own_thread_changes_no_bit(monkeypatch, idle):
    free = itertools.cycle(idle)
    monkeypatch.setattr(threads, "idle_cores", lambda: next(free))
    settings = Settings(n_crit=8)
    alone, together = (CriticTrainer(Robot(), settings, workers) for workers in (1, 2))
    for generation in (1, 2):
        for trainer in (alone, together):
            trainer.train(filled_replay(), settings, generation)
    assert_same_bits(alone, together)


@pytest.mark.parametrize("change", [{"seed": 4}, {"n_crit": 9}], ids=["seed", "steps"])
def test_another_seed_or_number_of_steps_gives_other_critics(change):
    assert not np.array_equal(
        trained().critic_parameters(), trained(SETTINGS.replace(**change)).critic_parameters()
    )


def test_generations_draw_different_batches():
    a, b = trained(generations=(1,)), trained(generations=(2,))
    assert not np.array_equal(a.critic_parameters(), b.critic_parameters())


def test_saved_loaded_and_continued_run_has_the_same_bits(tmp_path):
    straight = trained(generations=(1, 2, 3))
    save_checkpoint(tmp_path / "critic", trained(generations=(1, 2)).state(), {})
    arrays, _ = load_checkpoint(tmp_path / "critic")
    resumed = CriticTrainer(Robot(), SETTINGS)
    resumed.load_state(arrays)
    resumed.train(filled_replay(), SETTINGS, 3)
    assert_same_bits(resumed, straight)


def test_state_is_a_copy():
    trainer = trained()
    before = trainer.state()
    trainer.train(filled_replay(), SETTINGS, 2)
    assert not np.array_equal(before["critics"], trainer.state()["critics"])


@pytest.mark.parametrize(
    "damage",
    [
        lambda s: s.pop("greedy_moment2"),
        lambda s: s.update(critics=s["critics"][:, 1:]),
        lambda s: s.update(critics=s["critics"].astype(np.float64)),
    ],
    ids=["missing", "other shape", "other type"],
)
def test_state_of_other_networks_is_refused_and_changes_nothing(damage):
    trainer, state = CriticTrainer(Robot(), SETTINGS), trained().state()
    damage(state)
    with pytest.raises(StorageError, match="Saved critic array"):
        trainer.load_state(state)
    assert_same_bits(trainer, CriticTrainer(Robot(), SETTINGS))


def test_targets_start_as_copies_and_critics_differ():
    state = CriticTrainer(Robot(), SETTINGS).state()
    np.testing.assert_array_equal(state["critics"], state["critic_targets"])
    np.testing.assert_array_equal(state["greedy"], state["greedy_target"])
    assert not np.array_equal(state["critics"][0], state["critics"][1])


def test_greedy_init_best_starts_from_the_given_controller():
    trainer = trained()
    best = random_parameters(trainer.greedy_shape, np.random.default_rng(0))
    trainer.set_greedy(best)
    np.testing.assert_array_equal(trainer.greedy_parameters(), best)
    np.testing.assert_array_equal(trainer.state()["greedy_target"][0], best)
    assert not trainer.state()["greedy_moment1"].any()
    assert trainer.state()["greedy_steps"] == 0


def test_greedy_controller_of_another_shape_is_refused():
    with pytest.raises(NetworkError):
        CriticTrainer(Robot(), SETTINGS).set_greedy(np.zeros(3, np.float32))


def test_greedy_and_targets_wait_for_target_period():
    settings = SETTINGS.replace(n_crit=4, target_period=5)
    before, after = CriticTrainer(Robot(), settings).state(), trained(settings).state()
    for name in ("greedy", "greedy_target", "critic_targets"):
        np.testing.assert_array_equal(after[name], before[name])
    assert not np.array_equal(after["critics"], before["critics"])


@pytest.mark.parametrize(("period", "updates"), [(1, 10), (2, 5), (3, 3), (10, 1)])
def test_greedy_is_updated_every_target_period_steps(period, updates):
    state = trained(SETTINGS.replace(target_period=period)).state()
    assert state["greedy_steps"] == updates
    assert state["critic_steps"] == 10


def test_setting_terminal_matters_only_after_falls():
    bootstrap = SETTINGS.replace(terminal="bootstrap")
    standing, falling = filled_replay(fell=False), filled_replay(fell=True)
    assert_same_bits(trained(replay=standing), trained(bootstrap, replay=standing))
    assert_same_bits(trained(replay=standing), trained(bootstrap, replay=falling))
    assert not np.array_equal(
        trained(replay=standing).critic_parameters(), trained(replay=falling).critic_parameters()
    )


def test_setting_target_action_matters_only_beyond_the_limits():
    def pair(**noise):
        return [
            trained(SETTINGS.replace(target_action=choice, **noise)).critic_parameters()
            for choice in ("clip", "free")
        ]

    # Random controllers act within about ±0.7, and small noise does not exceed ±1.
    small, large = pair(smoothing_sigma=0.01), pair(smoothing_sigma=2.0, smoothing_clip=2.0)
    np.testing.assert_array_equal(*small)
    assert not np.array_equal(*large)


def test_smoothing_noise_stays_within_its_clip():
    a = trained(SETTINGS.replace(smoothing_sigma=10.0, smoothing_clip=0.0))
    b = trained(SETTINGS.replace(smoothing_sigma=0.0))
    assert_same_bits(a, b)


def test_statistics_are_those_of_the_steps():
    # One transition without reward and discount: y = 0, and every batch holds the same row.
    replay = ReplayBuffer(1, 4, 2)
    states, action = np.ones((2, 4), np.float32), np.full((1, 2), 0.5, np.float32)
    replay.add_episode(states, action, np.zeros(1, np.float32), terminated=False)
    still = SETTINGS.replace(discount=0.0, critic_learning_rate=0.0, greedy_learning_rate=0.0)
    trainer = CriticTrainer(Robot(), still)
    stats = trainer.train(replay, still, 1)

    def value(index, action):
        signal = np.concatenate((states[0], action))
        *hidden, (weights, biases) = trainer.critic_shape.layers(trainer.state()["critics"][index])
        for w, b in hidden:
            signal = np.maximum(w @ signal + b, 0)
        return (weights @ signal + biases)[0]

    assert stats == pytest.approx(
        {
            "critic_loss": value(0, action[0]) ** 2 + value(1, action[0]) ** 2,
            "mean_q": value(0, action[0]),
        },
        rel=1e-4,
    )


def test_empty_replay_is_refused():
    with pytest.raises(PgaError, match="replay buffer is empty"):
        CriticTrainer(Robot(), SETTINGS).train(ReplayBuffer(10, 4, 2), SETTINGS, 0)


def test_divergence_is_reported():
    with pytest.raises(NetworkError, match="diverged in generation 5"):
        CriticTrainer(Robot(), SETTINGS).train(filled_replay(rewards=1e30), SETTINGS, 5)


def test_unknown_device_is_refused():
    with pytest.raises(SettingsError, match="abacus"):
        SETTINGS.replace(device="abacus")


@pytest.mark.skipif(torch.cuda.is_available(), reason="error on a machine without a GPU")
def test_device_that_the_machine_lacks_is_refused():
    with pytest.raises(SettingsError, match=r"Device 'cuda' cannot be used here .*'auto' or 'cpu'"):
        CriticTrainer(Robot(), SETTINGS.replace(device="cuda"))


def test_auto_uses_a_gpu_if_there_is_one():
    device = CriticTrainer(Robot(), SETTINGS).device
    assert device.type == ("cuda" if torch.cuda.is_available() else "cpu")


@dataclass(frozen=True)
class Bandit:
    observation_dim: int = 1
    action_dim: int = 1


def test_greedy_controller_finds_the_optimum_of_a_quadratic_reward():
    """With one step per episode and reward -(a - 0.5 s)^2 for s within ±1, the best action is 0.5 s."""
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(3000, 1, 1)
    for _ in range(3000):
        state, action = rng.uniform(-1, 1, 2)
        reward = -((action - 0.5 * state) ** 2)
        replay.add_episode(
            np.array([[state], [state]]), np.array([[action]]), np.array([reward]), terminated=True
        )
    settings = SETTINGS.replace(
        n_crit=800, transition_batch=64, controller_hidden=(32,), critic_hidden=(64, 64)
    )
    trainer = CriticTrainer(Bandit(), settings)
    for generation, rate in enumerate((3e-3, 1e-3, 3e-4)):
        rates = settings.replace(critic_learning_rate=rate, greedy_learning_rate=rate)
        trainer.train(replay, rates, generation)
    controller = MlpController(trainer.greedy_shape, trainer.greedy_parameters())
    for state in (-0.8, -0.3, 0.0, 0.5, 0.9):
        assert abs(controller(np.float32([state]))[0] - 0.5 * state) < 0.05


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_batches_of_a_few_transitions_train(rows):
    settings = SETTINGS.replace(transition_batch=rows)
    alone, together = (CriticTrainer(Robot(), settings, workers) for workers in (1, 2))
    for trainer in (alone, together):
        trainer.train(filled_replay(), settings, 1)
    assert_same_bits(alone, together)
    assert alone.state()["greedy_steps"] == 5


@pytest.mark.parametrize("period", [1, 2, 3, 7, 50])
def test_training_may_be_divided_anywhere(period):
    """TD3 trains for one step per step of the robot: the result depends only on the steps."""
    settings = SETTINGS.replace(target_period=period)

    class Constant:
        """One batch of transitions, whatever is drawn."""

        def __init__(self):
            self._rows = filled_replay().rows(np.arange(16))

        def sample_indices(self, rng, n):
            return np.arange(n)

        def rows(self, indices, out=None):
            out[:] = self._rows
            return out

    still = settings.replace(smoothing_sigma=0.0)
    whole, divided = (CriticTrainer(Robot(), still) for _ in range(2))
    whole.train(Constant(), still, 1, range(1, 31))
    for steps in (range(1, 2), range(2, 6), range(6, 20), range(20, 31)):
        divided.train(Constant(), still, 1, steps)
    assert_same_bits(whole, divided)


@pytest.mark.parametrize("period", [1, 2, 3, 8, 50])
@pytest.mark.parametrize("steps", [range(1, 2), range(1, 31), range(7, 120)], ids=str)
def test_targets_move_only_after_the_last_step_of_a_block(steps, period):
    found = list(blocks(steps, period))
    assert [t for block in found for t in block] == list(steps)
    assert all(len(block) <= BLOCK for block in found)
    assert not any(t % period == 0 for block in found for t in block[:-1])
