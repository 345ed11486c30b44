"""Experience is complete before it is stored, intact when it is read, and deleted when it is too old."""

from __future__ import annotations

import numpy as np
import pytest
from lane_task import SETTINGS, Lane

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.tasks.rollout import Episode, rollout

SMALL = SETTINGS.replace(batch_size=4, n_evo=2)
ALWAYS_RIGHT = np.ones(2, np.float32)


def episode(number: int) -> Episode:
    """Return an episode that differs from all others; every third one leaves the lane."""
    action = ALWAYS_RIGHT if number % 3 == 0 else np.zeros(2, np.float32)
    return rollout(Lane(), lambda _: action, evaluation_rng(0, number))


def bits(one: Episode) -> tuple[object, ...]:
    arrays = (one.states, one.actions, one.rewards, one.descriptor)
    return (*(a.tobytes() for a in arrays), *(a.dtype for a in arrays), one.fitness, one.terminated)


def file_of(tmp_path, generation):
    return tmp_path / f"experience-{generation:08d}.ckpt"


def stored(tmp_path, generations, settings=SMALL):
    experience = Experience(tmp_path, settings)
    for generation in generations:
        for k in range(4 * generation, 4 * generation + 4):
            experience.stage(generation, k, episode(k))
        experience.store(generation)
    return experience


def test_episodes_in_any_order_are_returned_in_evaluation_order(tmp_path):
    experience = Experience(tmp_path, SMALL)
    for k in (6, 4, 7, 5):
        experience.stage(1, k, episode(k))
    assert [bits(e) for e in experience.episodes(1)] == [bits(episode(k)) for k in (4, 5, 6, 7)]


def test_episodes_are_read_back_bit_for_bit(tmp_path):
    stored(tmp_path, [0])
    episodes = Experience(tmp_path, SMALL).episodes(0)
    assert {e.terminated for e in episodes} == {True, False}
    assert [bits(e) for e in episodes] == [bits(episode(k)) for k in range(4)]


def test_a_duplicate_is_dropped(tmp_path):
    experience = Experience(tmp_path, SMALL)
    assert experience.stage(0, 1, episode(1))
    assert not experience.stage(0, 1, episode(2))
    for k in (0, 2, 3):
        experience.stage(0, k, episode(k))
    assert bits(experience.episodes(0)[1]) == bits(episode(1))


def test_an_episode_of_another_evaluation_with_the_same_id_is_dropped(tmp_path):
    experience = Experience(tmp_path, SMALL)
    fitness = np.array([episode(k).fitness for k in range(4)])
    for k in range(4):
        experience.stage(0, k, episode(9 if k == 2 else k))
    experience.drop_others(0, fitness)
    assert experience.missing(0) == [2]
    experience.stage(0, 2, episode(2))
    experience.drop_others(0, fitness)
    assert [bits(e) for e in experience.episodes(0)] == [bits(episode(k)) for k in range(4)]


def test_missing_episodes_are_named(tmp_path):
    experience = Experience(tmp_path, SMALL)
    for k in (8, 10):
        experience.stage(2, k, episode(k))
    assert experience.missing(2) == [9, 11]


def test_a_stored_file_does_not_count_for_a_repeated_generation(tmp_path):
    stored(tmp_path, [0, 1])
    assert Experience(tmp_path, SMALL).missing(1) == [4, 5, 6, 7]


@pytest.mark.parametrize(("generation", "evaluation"), [(1, 3), (1, 8), (0, -1)])
def test_an_evaluation_of_another_generation_is_refused(tmp_path, generation, evaluation):
    with pytest.raises(RequestError, match=f"Evaluation {evaluation} is not of generation"):
        Experience(tmp_path, SMALL).stage(generation, evaluation, episode(0))


def test_an_incomplete_generation_is_not_stored(tmp_path):
    experience = Experience(tmp_path, SMALL)
    for k in (0, 1, 3):
        experience.stage(0, k, episode(k))
    with pytest.raises(RequestError, match=r"1 episodes of generation 0 .* evaluation 2"):
        experience.store(0)
    assert not list(tmp_path.iterdir())


def test_an_incomplete_generation_has_no_episodes(tmp_path):
    experience = Experience(tmp_path, SMALL)
    experience.stage(0, 1, episode(1))
    with pytest.raises(RequestError, match="generation 0 is not here"):
        experience.episodes(0)


def test_a_straggler_does_not_hide_the_stored_file(tmp_path):
    experience = stored(tmp_path, [0, 1, 2])
    experience.stage(0, 2, episode(99))
    assert [bits(e) for e in experience.episodes(0)] == [bits(episode(k)) for k in range(4)]


def test_storing_again_replaces_the_file(tmp_path):
    stored(tmp_path, [0])
    experience = Experience(tmp_path, SMALL)
    for k in range(4):
        experience.stage(0, k, episode(k + 20))
    experience.store(0)
    assert bits(Experience(tmp_path, SMALL).episodes(0)[0]) == bits(episode(20))


@pytest.mark.parametrize("cut", [0, 7, 40, 500, -1])
def test_a_truncated_file_is_reported(tmp_path, cut):
    stored(tmp_path, [0])
    whole = file_of(tmp_path, 0).read_bytes()
    file_of(tmp_path, 0).write_bytes(whole[:cut])
    with pytest.raises(StorageError, match="experience-00000000"):
        Experience(tmp_path, SMALL).episodes(0)


def test_a_damaged_file_is_reported(tmp_path):
    stored(tmp_path, [0])
    damaged = bytearray(file_of(tmp_path, 0).read_bytes())
    damaged[len(damaged) // 2] ^= 1
    file_of(tmp_path, 0).write_bytes(damaged)
    with pytest.raises(StorageError, match="damaged"):
        Experience(tmp_path, SMALL).episodes(0)


def test_a_file_of_another_generation_is_reported(tmp_path):
    stored(tmp_path, [0, 1])
    file_of(tmp_path, 0).replace(file_of(tmp_path, 1))
    with pytest.raises(StorageError, match="not the experience of generation 1"):
        Experience(tmp_path, SMALL).episodes(1)


def test_window_is_everything_stored_up_to_a_generation(tmp_path):
    experience = stored(tmp_path, range(5))
    assert list(experience.window(3)) == [0, 1, 2, 3]


def test_window_before_the_first_generation_is_empty(tmp_path):
    assert list(Experience(tmp_path, SMALL).window(-1)) == []


@pytest.mark.parametrize("gap", [1, 3])
def test_a_gap_in_the_window_is_reported(tmp_path, gap):
    experience = stored(tmp_path, range(4))
    file_of(tmp_path, gap).unlink()
    with pytest.raises(StorageError, match=f"generation {gap} is missing"):
        experience.window(3)


def test_a_window_without_any_files_is_reported(tmp_path):
    with pytest.raises(StorageError, match="experience of generation 3 is missing"):
        Experience(tmp_path, SMALL).window(3)


@pytest.mark.parametrize("restarted", [False, True], ids=["same-process", "new-process"])
def test_what_the_replay_buffer_has_overwritten_is_deleted(tmp_path, restarted):
    """Without the two newest generations, the remaining files just fill the buffer."""
    settings = SMALL.replace(replay_size=100)
    for generation in range(12):
        if restarted or not generation:
            experience = Experience(tmp_path, settings)
        for k in range(4 * generation, 4 * generation + 4):
            experience.stage(generation, k, episode(k))
        experience.store(generation)
    lengths = [sum(e.length for e in experience.episodes(g)) for g in experience.window(9)]
    assert sum(lengths) >= 100 > sum(lengths[1:])
    assert not file_of(tmp_path, 9 - len(lengths)).exists()


def test_the_window_is_no_longer_than_the_replay_buffer(tmp_path):
    experience = stored(tmp_path, range(12))
    wanted = sum(e.length for g in (10, 11) for e in experience.episodes(g))
    settings = SMALL.replace(replay_size=wanted)
    assert list(Experience(tmp_path, settings).window(11)) == [10, 11]


def test_a_window_that_has_lost_its_beginning_is_reported(tmp_path):
    stored(tmp_path, range(4))
    file_of(tmp_path, 0).unlink()
    with pytest.raises(StorageError, match="generation 0 is missing"):
        Experience(tmp_path, SMALL).window(3)


def test_other_files_in_the_folder_are_left_alone(tmp_path):
    for name in ("experience-00000000.ckpt.tmp", "notes.txt", "experience-1.ckpt"):
        (tmp_path / name).touch()
    stored(tmp_path, range(4), SMALL.replace(replay_size=1))
    assert not file_of(tmp_path, 0).exists()
    assert (tmp_path / "notes.txt").exists()
    assert (tmp_path / "experience-1.ckpt").exists()
