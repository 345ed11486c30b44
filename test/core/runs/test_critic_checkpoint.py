"""Outcomes of trainings on disk are found by their order, and kept as long as they may be needed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.runs.critic_checkpoints import KEPT, CriticCheckpoints
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.storage.checkpoint import load_checkpoint, save_checkpoint
from pga_me_ros.errors import StorageError

CRITIC, GREEDY = MlpShape((5, 4, 1)), MlpShape((3, 4, 2))
RATES = Settings()


def order(generation, experience=None, **rates):
    newest = generation - 2 if experience is None else experience
    return TrainingOrder.of(generation, newest, RATES.replace(**rates))


def outcome(generation):
    rng = np.random.default_rng(generation)
    snapshot = Snapshot(
        generation=generation,
        version=300 * generation,
        networks={
            "critic": (CRITIC, rng.random(CRITIC.parameter_count, np.float32)),
            "greedy": (GREEDY, rng.random(GREEDY.parameter_count, np.float32)),
        },
        states=rng.random((1, 2, 4, 3), np.float32),
        transitions=1234,
        critic_loss=float(rng.random()),
        mean_q=-float(rng.random()),
    )
    state = {
        "critics": rng.random((2, 7), np.float32),
        "critic_steps": np.float32(3.0) * np.ones(()),
    }
    return snapshot, state


def saved(folder, generations):
    checkpoints = CriticCheckpoints(folder)
    for generation in generations:
        checkpoints.save(order(generation), *outcome(generation))
    return checkpoints


def assert_same(found, wanted):
    assert found is not None
    for f in dataclasses.fields(Snapshot):
        ours, theirs = getattr(found[0], f.name), getattr(wanted[0], f.name)
        assert type(ours) is type(theirs)
        if f.name == "networks":
            assert list(ours) == list(theirs)
            for name, (shape, parameters) in ours.items():
                assert shape == theirs[name][0]
                np.testing.assert_array_equal(parameters, theirs[name][1], strict=True)
        else:
            np.testing.assert_array_equal(ours, theirs)
    assert list(found[1]) == list(wanted[1])
    for name, array in found[1].items():
        np.testing.assert_array_equal(array, wanted[1][name], strict=True)


def test_an_outcome_is_read_back_bit_for_bit(tmp_path):
    saved(tmp_path, [5])
    assert_same(CriticCheckpoints(tmp_path).find(order(5)), outcome(5))


def test_an_outcome_without_critics_is_read_back(tmp_path):
    snapshot, state = outcome(5)
    evolved = without_critics(snapshot)
    CriticCheckpoints(tmp_path).save(order(5), evolved, state)
    assert_same(CriticCheckpoints(tmp_path).find(order(5)), (evolved, state))


def without_critics(snapshot):
    """Return a snapshot of an evolution strategy."""
    shape, greedy = snapshot.network("greedy")
    networks = {"greedy": (shape, greedy), "center": (shape, greedy + 1)}
    none = np.empty((0, 0, 0, 0), np.float32)
    return dataclasses.replace(snapshot, networks=networks, states=none)


def diverse(snapshot):
    """Return a snapshot with a critic of diversity."""
    shape, critic = snapshot.network("critic")
    networks = {**snapshot.networks, "diversity_critic": (shape, critic + 1)}
    return dataclasses.replace(snapshot, networks=networks)


@pytest.mark.parametrize("absent", [(), ("diversity_critic",), ("center", "diversity_critic")])
@pytest.mark.parametrize("of", [lambda s: s, without_critics, diverse])
def test_a_file_with_a_field_per_network_is_read(of, absent, tmp_path):
    """Older files have the layers of critics and controllers only once each; the oldest lack the newer fields."""
    snapshot, state = outcome(5)
    snapshot = of(snapshot)
    CriticCheckpoints(tmp_path).save(order(5), snapshot, state)
    path = tmp_path / "critic-00000005.ckpt"
    arrays, meta = load_checkpoint(path)
    sizes = meta.pop("networks")
    meta |= {"critic_shape": sizes.get("critic"), "greedy_shape": sizes["greedy"]}
    for name in ("critic", "greedy", "center", "diversity_critic"):
        array = arrays.pop(f"snapshot.networks.{name}", None)
        if array is not None:
            arrays[f"snapshot.{name}"] = array
        elif name == "critic":
            arrays["snapshot.critic"] = np.empty(0, np.float32)
        elif name not in absent:
            meta[name] = None
    save_checkpoint(path, arrays, meta)
    assert_same(CriticCheckpoints(tmp_path).find(order(5)), (snapshot, state))


@pytest.mark.parametrize(
    "other", [order(4), order(5, 2), order(5, n_crit=299), order(5, discount=0.98)]
)
def test_another_order_finds_nothing(tmp_path, other):
    assert saved(tmp_path, [5]).find(other) is None


def test_the_newest_earlier_outcome_is_the_state_before(tmp_path):
    checkpoints = saved(tmp_path, [5, 6, 8])
    assert_same(checkpoints.before(8), outcome(6))
    assert_same(checkpoints.before(100), outcome(8))


def test_nothing_is_before_the_first(tmp_path):
    assert saved(tmp_path, [5, 6]).before(5) is None


def test_only_the_newest_are_kept(tmp_path):
    checkpoints = saved(tmp_path, range(5, 12))
    kept = [g for g in range(5, 12) if checkpoints.find(order(g))]
    assert kept == list(range(12 - KEPT, 12))


def test_outcomes_based_on_a_replaced_one_are_deleted(tmp_path):
    checkpoints = saved(tmp_path, [5, 6, 7])
    checkpoints.save(order(6, n_crit=7), *outcome(6))
    assert checkpoints.find(order(7)) is None
    assert_same(checkpoints.before(8), outcome(6))


def test_a_damaged_file_is_reported(tmp_path):
    checkpoints = saved(tmp_path, [5])
    path = tmp_path / "critic-00000005.ckpt"
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(StorageError, match="critic-00000005"):
        checkpoints.find(order(5))


@pytest.mark.parametrize(
    ("arrays", "meta"),
    [({}, {}), ({"snapshot.critic": np.zeros(3)}, {"order": {}}), ({}, {"order": {}, "loss": 1.0})],
)
def test_a_file_with_other_content_is_reported(tmp_path, arrays, meta):
    save_checkpoint(tmp_path / "critic-00000005.ckpt", arrays, meta)
    with pytest.raises(StorageError, match="holds no outcome of a critic training"):
        CriticCheckpoints(tmp_path).find(order(5))


def test_outcomes_of_trainings_in_an_interrupted_generation_are_discarded(tmp_path):
    checkpoints = saved(tmp_path, [5, 6, 7])  # each trained in the generation before
    checkpoints.discard_since(6)
    assert checkpoints.find(order(7)) is None
    assert_same(checkpoints.find(order(6)), outcome(6))
    checkpoints.save(order(7, experience=6), *outcome(7))  # trained in generation 7 itself
    checkpoints.discard_since(7)
    assert_same(checkpoints.before(8), outcome(6))


def test_a_damaged_outcome_that_may_be_needed_is_reported_and_kept(tmp_path):
    checkpoints = saved(tmp_path, [5, 6])
    for generation in (5, 6):
        path = tmp_path / f"critic-0000000{generation}.ckpt"
        path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(StorageError, match="critic-00000005"):
        checkpoints.discard_since(5)
    assert (tmp_path / "critic-00000005.ckpt").exists()
