"""PG variation compared with textbook torch, and bit for bit alone, in a batch and with workers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch

from pga_me_ros.core.gradients import threads
from pga_me_ros.core.networks.mlp import MlpShape, random_critic, random_parameters
from pga_me_ros.core.variation.policy_gradient import pg_variation
from pga_me_ros.errors import NetworkError

CONTROLLER, CRITIC = MlpShape((22, 128, 128, 6)), MlpShape((28, 256, 256, 1))
RNG = np.random.default_rng(0)
PARENTS = np.stack([random_parameters(CONTROLLER, RNG) for _ in range(7)])
Q1 = random_critic(CRITIC, RNG)
SHARED = RNG.standard_normal((4, 64, 22), np.float32)
OWN = RNG.standard_normal((7, 4, 64, 22), np.float32)
BATCHES = pytest.mark.parametrize("states", [SHARED, OWN], ids=["shared", "own"])


def offspring(parents, states, **options):
    return pg_variation(parents, Q1, states, 1e-3, CONTROLLER, CRITIC, **options)


def module_of(shape, flat, *, tanh):
    layers = []
    for n_in, n_out in zip(shape.sizes[:-1], shape.sizes[1:], strict=True):
        layers += [torch.nn.Linear(n_in, n_out), torch.nn.ReLU()]
    module = torch.nn.Sequential(*layers[:-1], *([torch.nn.Tanh()] if tanh else [])).double()
    torch.nn.utils.vector_to_parameters(
        torch.from_numpy(flat.astype(np.float64)), module.parameters()
    )
    return module


def textbook_offspring(parent, batches, learning_rate):
    """Return one offspring, made with autograd and torch.optim.Adam in float64."""
    controller = module_of(CONTROLLER, parent, tanh=True)
    critic = module_of(CRITIC, Q1, tanh=False)
    optimizer = torch.optim.Adam(controller.parameters(), learning_rate)
    for batch in torch.from_numpy(batches.astype(np.float64)):
        optimizer.zero_grad()
        (-critic(torch.cat((batch, controller(batch)), 1)).mean()).backward()
        optimizer.step()
    return torch.nn.utils.parameters_to_vector(controller.parameters()).detach().numpy()


@BATCHES
def test_offspring_equal_textbook_gradient_ascent(states):
    got = offspring(PARENTS, states, device="auto")
    for i in (0, 6):
        wanted = textbook_offspring(PARENTS[i], states if states is SHARED else states[i], 1e-3)
        assert np.abs(wanted - PARENTS[i]).max() > 1e-3
        # Where a gradient almost vanishes, Adam divides rounding errors by each other: most
        # parameters agree closely, but not all.
        assert np.quantile(np.abs(got[i] - wanted), 0.999) < 1e-5
        assert np.abs(got[i] - wanted).max() < 1e-3


@BATCHES
def test_each_offspring_alone_has_the_bits_of_the_batch(states):
    together = offspring(PARENTS, states)
    for i in range(len(PARENTS)):
        alone = offspring(PARENTS[i : i + 1], states if states is SHARED else states[i : i + 1])
        assert alone[0].tobytes() == together[i].tobytes()


@BATCHES
@pytest.mark.parametrize("idle", [[20], [0], [2, -1]], ids=["many", "none", "now and then"])
@pytest.mark.parametrize("workers", [2, 3, 20])
def test_number_of_workers_changes_no_bit(monkeypatch, states, workers, idle):
    one = offspring(PARENTS, states)
    free = itertools.cycle(idle)
    monkeypatch.setattr(threads, "idle_cores", lambda: next(free))
    assert offspring(PARENTS, states, workers=workers).tobytes() == one.tobytes()


def test_order_of_parents_changes_no_bit():
    reverse = offspring(np.ascontiguousarray(PARENTS[::-1]), SHARED)
    assert reverse[::-1].tobytes() == offspring(PARENTS, SHARED).tobytes()


def test_mean_action_value_rises():
    critic = module_of(CRITIC, Q1, tanh=False)

    def value(parameters):
        states = torch.from_numpy(SHARED.astype(np.float64)).flatten(0, 1)
        controller = module_of(CONTROLLER, parameters, tanh=True)
        return critic(torch.cat((states, controller(states)), 1)).mean().item()

    for parent, child in zip(PARENTS, offspring(PARENTS, SHARED), strict=True):
        assert value(child) > value(parent)


def test_own_batches_differ_from_shared_ones():
    assert not np.array_equal(offspring(PARENTS, SHARED), offspring(PARENTS, OWN))


def test_parents_critic_and_states_are_unchanged():
    before = PARENTS.copy(), Q1.copy(), SHARED.copy()
    offspring(PARENTS, SHARED)
    for kept, now in zip(before, (PARENTS, Q1, SHARED), strict=True):
        np.testing.assert_array_equal(now, kept)


@pytest.mark.parametrize("workers", [1, 3])
def test_caller_keeps_its_threads(workers):
    before = torch.get_num_threads()
    offspring(PARENTS, SHARED, threads=before + 1, workers=workers)
    assert torch.get_num_threads() == before


def test_the_same_call_gives_the_same_bits():
    first = offspring(PARENTS, SHARED, device="auto")
    assert offspring(PARENTS, SHARED, device="auto").tobytes() == first.tobytes()


def test_no_parents_give_no_offspring():
    assert offspring(PARENTS[:0], SHARED).shape == (0, CONTROLLER.parameter_count)


@pytest.mark.parametrize(
    ("parents", "states", "message"),
    [
        (PARENTS[:, :-1], SHARED, "belong to the same layer sizes"),
        (PARENTS[0], SHARED, r"expected \(n, P\)"),
        (PARENTS, SHARED[..., :-1], "State batches"),
        (PARENTS[:3], OWN, "State batches"),
        (PARENTS, SHARED.astype(np.float64), "State batches"),
        (PARENTS, SHARED[:, :0], "hold no states"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(parents, states, message):
    with pytest.raises(NetworkError, match=message):
        offspring(parents, states)


def test_a_critic_of_another_robot_is_refused():
    other = MlpShape((30, 8, 1))
    with pytest.raises(NetworkError, match="is incompatible with"):
        pg_variation(PARENTS, np.zeros(257, np.float32), SHARED, 1e-3, CONTROLLER, other)
