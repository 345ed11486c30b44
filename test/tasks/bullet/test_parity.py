"""Our locomotion tasks equal stock pybullet_envs, bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pytest
from stock import StockTask

from pga_me_ros.tasks.registry import BUILT_IN, load_task
from pga_me_ros.tasks.rollout import rollout

GAITS = Path(__file__).parents[1] / "data" / "gaits.npz"

Controller = Callable[[np.ndarray], np.ndarray]


def generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def random_actions(dimension: int, seed: int, amplitude: float = 1.0) -> Controller:
    rng = generator(1000 + seed)
    return lambda _: (amplitude * rng.uniform(-1, 1, dimension)).astype(np.float32)


def zero_actions(dimension: int) -> Controller:
    return lambda _: np.zeros(dimension, np.float32)


def learned_gait(name: str) -> Controller:
    """Return a linear controller from a random search: (action_dim, observation_dim + 1), bias last."""
    with np.load(GAITS) as file:
        weights = file[name]
    return lambda observation: np.tanh(weights[:, :-1] @ observation + weights[:, -1])


def record(task: Any, controller: Controller, seed: int, steps: int, past_falls: bool) -> dict:
    """Run one episode and keep, as bytes, everything in which the two sides must agree."""
    observation = task.reset(generator(seed))
    trace: dict[str, Any] = {"observations": [observation.tobytes()], "rewards": []}
    trace |= {"contacts": [], "terminated": []}
    for _ in range(steps):
        observation, reward, terminated = task.step(controller(observation))
        trace["observations"].append(observation.tobytes())
        trace["rewards"].append(np.float64(reward).tobytes())
        trace["contacts"].append(task.contacts())
        trace["terminated"].append(terminated)
        if terminated and not past_falls:
            break
    return trace


def assert_parity(
    ours: Any, stock: Any, make: Callable[[], Controller], seed: int, steps: int, past: bool = False
) -> dict:
    mine, theirs = (record(task, make(), seed, steps, past) for task in (ours, stock))
    for what, values in theirs.items():
        differing = [
            t for t, pair in enumerate(zip(mine[what], values, strict=False)) if pair[0] != pair[1]
        ]
        assert not differing, f"{what} differ first at entry {differing[0]}"
        assert len(mine[what]) == len(values), what
    return theirs


@pytest.fixture(scope="module", params=list(BUILT_IN))
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def ours(name: str) -> Iterator[Any]:
    task = load_task(name)()
    yield task
    task.close()


@pytest.fixture(scope="module")
def stock(name: str) -> Iterator[Any]:
    task = StockTask(name)
    yield task
    task.close()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_actions(ours: Any, stock: Any, seed: int) -> None:
    make = lambda: random_actions(ours.spec.action_dim, seed)  # noqa: E731
    assert_parity(ours, stock, make, seed, 150)


@pytest.mark.parametrize("seed", [4, 5])
def test_zero_actions(ours: Any, stock: Any, seed: int) -> None:
    assert_parity(ours, stock, lambda: zero_actions(ours.spec.action_dim), seed, 150)


def test_past_a_fall(name: str, ours: Any, stock: Any) -> None:
    make = lambda: random_actions(ours.spec.action_dim, 14)  # noqa: E731
    trace = assert_parity(ours, stock, make, 14, 250, past=True)
    assert any(trace["terminated"]) == (name != "qd_half_cheetah")


def test_actions_beyond_the_limits(ours: Any, stock: Any) -> None:
    make = lambda: random_actions(ours.spec.action_dim, 7, amplitude=3.0)  # noqa: E731
    assert_parity(ours, stock, make, 7, 100, past=True)


def test_learned_gait_to_the_time_limit(name: str, ours: Any, stock: Any) -> None:
    trace = assert_parity(ours, stock, lambda: learned_gait(name), 1, 1000)
    assert len(trace["rewards"]) == 1000, "the stored gait no longer reaches the time limit"


def test_observations_beyond_five_are_clipped(ours: Any, stock: Any) -> None:
    world = ours._world
    for task in (ours, stock):
        task.reset(generator(9))
    pybullet.resetJointState(world.robot, world.joints[0], 0.0, 95.0, world.client)
    stock.spin(95.0)
    action = np.zeros(ours.spec.action_dim, np.float32)
    mine, theirs = ours.step(action), stock.step(action)
    assert np.abs(theirs[0]).max() == 5.0
    assert (mine[0].tobytes(), mine[1:]) == (theirs[0].tobytes(), theirs[1:])


def test_every_joint_at_its_limits(ours: Any, stock: Any) -> None:
    def push(_: np.ndarray) -> np.ndarray:
        return np.full(ours.spec.action_dim, next(signs), np.float32)

    def make() -> Controller:
        nonlocal signs
        signs = iter([1.0] * 40 + [-1.0] * 40)
        return push

    signs: Iterator[float] = iter(())
    assert_parity(ours, stock, make, 8, 80, past=True)


def test_second_and_tenth_episode_of_a_world(name: str) -> None:
    ours, stock = load_task(name)(), StockTask(name)
    try:
        for episode in range(10):
            make = lambda: random_actions(ours.spec.action_dim, 20)  # noqa: E731
            assert_parity(ours, stock, make, 50 + episode, 40, past=episode % 2 == 0)
    finally:
        ours.close()
        stock.close()


def test_descriptor_is_the_share_of_steps_in_contact(name: str, ours: Any, stock: Any) -> None:
    order = {"qd_half_cheetah": [0, 3]}.get(name, slice(None))
    episode = rollout(ours, learned_gait(name), generator(2), max_steps=200)
    trace = record(stock, learned_gait(name), 2, 200, past_falls=False)
    share = np.array(trace["contacts"], float).mean(axis=0)[order]
    assert episode.descriptor.tolist() == pytest.approx(share.tolist(), abs=1e-12)


def test_fitness_is_the_sum_of_stock_rewards(name: str, ours: Any, stock: Any) -> None:
    episode = rollout(ours, learned_gait(name), generator(3), max_steps=200)
    trace = record(stock, learned_gait(name), 3, 200, past_falls=False)
    total = 0.0
    for reward in trace["rewards"]:
        total += float(np.frombuffer(reward)[0])
    assert episode.fitness == total
