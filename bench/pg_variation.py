"""PG variation of 50 offspring by 10 steps each, compared with one at a time in plain torch.

Run: `.venv/bin/python bench/pg_variation.py [--rounds 5] [--workers 1]`; the last line is JSON.
Every figure is a ratio of two things measured in turn (A B A B ...) in this process.
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise

import numpy as np
import torch
from _measure import product_rate, seconds, spread
from torch import nn

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.mlp import MlpShape, random_critic, random_parameters
from pga_me_ros.core.variation.policy_gradient import pg_variation

CONTROLLER = MlpShape((22, 128, 128, 6))
CRITIC = MlpShape((28, 256, 256, 1))
LEARNING_RATE = 1e-3


def module_of(shape: MlpShape, flat: Float32Array, *, tanh: bool) -> nn.Sequential:
    """Return a torch module with the parameters of a flat vector."""
    layers: list[nn.Module] = []
    for n_in, n_out in pairwise(shape.sizes):
        layers += [nn.Linear(n_in, n_out), nn.ReLU()]
    module = nn.Sequential(*layers[:-1], *([nn.Tanh()] if tanh else []))
    nn.utils.vector_to_parameters(torch.from_numpy(flat.copy()), module.parameters())
    return module


def textbook_offspring(
    parent: Float32Array, critic: nn.Module, batches: Float32Array
) -> Float32Array:
    """Make one offspring with modules, autograd and `torch.optim.Adam`."""
    controller = module_of(CONTROLLER, parent, tanh=True)
    optimiser = torch.optim.Adam(controller.parameters(), LEARNING_RATE)
    for states in torch.from_numpy(batches):
        loss = -critic(torch.cat([states, controller(states)], 1)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return nn.utils.parameters_to_vector(controller.parameters()).detach().numpy()


def needed_operations(rows: int) -> int:
    """Return the operations of one step of one offspring, counting only matrix products."""
    (obs, first, *_), (_, critic_first, *_) = CONTROLLER.sizes, CRITIC.sizes
    act = CONTROLLER.sizes[-1]
    actor = sum(2 * rows * a * b for a, b in pairwise(CONTROLLER.sizes))
    critic = sum(2 * rows * a * b for a, b in pairwise(CRITIC.sizes))
    through_critic = (
        critic - 2 * rows * CRITIC.sizes[0] * critic_first + 2 * rows * act * critic_first
    )
    through_actor = 2 * actor - 2 * rows * obs * first
    return actor + critic + through_critic + through_actor


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--offspring", type=int, default=50)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    parents = np.stack([random_parameters(CONTROLLER, rng) for _ in range(arguments.offspring)])
    flat_critic = random_critic(CRITIC, rng)
    critic = module_of(CRITIC, flat_critic, tanh=False)
    states = rng.standard_normal((10, 256, CONTROLLER.sizes[0]), np.float32)

    def ours(workers: int) -> Float32Array:
        return pg_variation(
            parents, flat_critic, states, LEARNING_RATE, CONTROLLER, CRITIC, workers=workers
        )

    def textbook() -> list[Float32Array]:
        return [textbook_offspring(parent, critic, states) for parent in parents]

    textbook_offspring(parents[0], critic, states)
    ours(1)
    operations = needed_operations(256) * 10 * len(parents)
    speedups, shares, textbook_shares, workers_gain = [], [], [], []
    for _ in range(arguments.rounds):
        rate_before = product_rate()
        a = seconds(lambda: ours(1))
        rate = (rate_before + product_rate()) / 2
        b = seconds(textbook)
        speedups.append(b / a)
        shares.append(operations / a / rate)
        textbook_shares.append(operations / b / rate)
        print(f"ours {a:.2f} s, one by one {b:.2f} s, matrix products {rate / 1e9:.0f} GFLOP/s")
        if arguments.workers > 1:
            workers_gain.append(seconds(lambda: ours(1)) / seconds(lambda: ours(arguments.workers)))
    figures = {
        "speedup_over_textbook": spread(speedups),
        "share_of_product_rate": spread(shares),
        "textbook_share_of_product_rate": spread(textbook_shares),
    }
    if workers_gain:
        figures[f"gain_of_{arguments.workers}_workers"] = spread(workers_gain)
    for name, values in figures.items():
        print(f"{name:32} {values['median']:.2f}  ({values['min']:.2f} to {values['max']:.2f})")
    print(json.dumps({"bench": "pg_variation", "figures": figures}))


if __name__ == "__main__":
    main()
