"""The replay buffer compared with a plain list of transitions."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.learning.replay_buffer import ReplayBuffer
from pga_me_ros.errors import PgaError

OBS, ACT = 3, 2


def episode(steps, first=0):
    """Return an episode in which every number identifies its place."""
    states = 100.0 * (first + np.arange(steps + 1))[:, None] + np.arange(OBS)
    actions = -100.0 * (first + np.arange(steps))[:, None] - np.arange(ACT)
    rewards = first + np.arange(steps) + 0.5
    return [a.astype(np.float32) for a in (states, actions, rewards)]


def rows_of(states, actions, rewards, fell):
    """Return rows [s, a, s', r, not_done], made by a plain loop."""
    last = len(actions) - 1
    return [
        [*states[t], *actions[t], *states[t + 1], rewards[t], float(not (fell and t == last))]
        for t in range(len(actions))
    ]


def all_rows(buffer):
    return buffer.rows(np.arange(len(buffer)))


def test_rows_hold_state_action_next_state_reward_and_mask():
    buffer = ReplayBuffer(100, OBS, ACT)
    buffer.add_episode(*episode(4), terminated=True, max_steps=1000)
    np.testing.assert_array_equal(all_rows(buffer), rows_of(*episode(4), fell=True))


@pytest.mark.parametrize(
    ("terminated", "max_steps", "last_not_done"),
    [(True, 1000, 0.0), (True, None, 0.0), (False, 5, 1.0), (False, None, 1.0), (True, 5, 1.0)],
    ids=["fall", "fall without limit", "limit", "cut", "fall in the last step"],
)
def test_only_a_fall_before_the_time_limit_is_terminal(terminated, max_steps, last_not_done):
    buffer = ReplayBuffer(100, OBS, ACT)
    buffer.add_episode(*episode(5), terminated=terminated, max_steps=max_steps)
    np.testing.assert_array_equal(all_rows(buffer)[:, -1], [1, 1, 1, 1, last_not_done])


@pytest.mark.parametrize("capacity", [1, 4, 7, 10, 23, 1000])
def test_ring_holds_the_newest_transitions_oldest_first(capacity):
    buffer = ReplayBuffer(capacity, OBS, ACT)
    plain, first = [], 0
    for steps in (3, 4, 1, 9, 2, 30, 5, 4):
        arrays = episode(steps, first)
        fell = steps % 2 == 0
        buffer.add_episode(*arrays, terminated=fell)
        plain += rows_of(*arrays, fell=fell)
        first += steps
        np.testing.assert_array_equal(all_rows(buffer), plain[-capacity:])
    assert len(buffer) == min(capacity, first)


def test_samples_are_uniform_over_what_is_held():
    buffer = ReplayBuffer(50, OBS, ACT)
    buffer.add_episode(*episode(20), terminated=False)
    counts = np.bincount(buffer.sample_indices(np.random.default_rng(0), 40_000))
    assert len(counts) == 20
    # Chi-squared with 19 degrees of freedom exceeds 50 once in ten thousand.
    assert ((counts - 2000) ** 2 / 2000).sum() < 50


def test_a_buffer_filled_again_gives_the_same_batches_although_the_first_had_wrapped():
    buffer, again = ReplayBuffer(10, OBS, ACT), ReplayBuffer(10, OBS, ACT)
    for first in (0, 4, 8, 12):
        buffer.add_episode(*episode(4, first), terminated=True)
    for first in (4, 8, 12):
        again.add_episode(*episode(4, first), terminated=True)
    indices = again.sample_indices(np.random.default_rng(0), 64)
    np.testing.assert_array_equal(again.rows(indices), buffer.rows(indices))


def test_rows_are_written_to_out():
    buffer = ReplayBuffer(10, OBS, ACT)
    buffer.add_episode(*episode(6), terminated=True)
    out = np.zeros((2, buffer.width), np.float32)
    buffer.rows(np.array([5, 0]), out=out)
    np.testing.assert_array_equal(out, all_rows(buffer)[[5, 0]])


def test_state_batches_are_states_that_were_added():
    buffer = ReplayBuffer(10, OBS, ACT)
    buffer.add_episode(*episode(6), terminated=True)
    batches = buffer.state_batches(np.random.default_rng(0), 4, 8)
    assert batches.shape == (4, 8, OBS)
    assert batches.flags.c_contiguous
    assert set(batches[..., 0].ravel()) == {0, 100, 200, 300, 400, 500}
    np.testing.assert_array_equal(batches[..., 2] - batches[..., 0], 2)


def test_an_empty_buffer_is_reported():
    with pytest.raises(PgaError, match="empty"):
        ReplayBuffer(10, OBS, ACT).sample_indices(np.random.default_rng(0), 3)


def test_arrays_of_different_episodes_are_refused():
    states, actions, rewards = episode(5)
    with pytest.raises(PgaError, match=r"T \+ 1 states"):
        ReplayBuffer(10, OBS, ACT).add_episode(states[:-1], actions, rewards, terminated=True)


def test_reserving_a_large_buffer_takes_no_memory():
    def resident_pages():
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1])

    before = resident_pages()
    buffer = ReplayBuffer(1_000_000, 28, 8)
    buffer.add_episode(
        np.zeros((11, 28), np.float32),
        np.zeros((10, 8), np.float32),
        np.zeros(10, np.float32),
        terminated=True,
    )
    assert (resident_pages() - before) * 4096 < 20e6
