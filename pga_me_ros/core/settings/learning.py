"""Settings of variation and of critic training: Table 1 of Nilsson & Cully (2021)."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.field import setting
from pga_me_ros.core.settings.run import RunSettings


@dataclass(frozen=True)
class LearningSettings(RunSettings):
    """How offspring are made and how critics are trained; most of it may change from generation to generation."""

    n_evo: int = setting(
        -1,
        "Offspring per generation by genetic variation; batch_size: standard MAP-Elites, 0: policy gradients only, "
        "-1: the algorithm's own number (half the batch).",
        low=-1,
        high=100_000,
        own=True,
        unit="offspring",
        symbol="n_evo",
        rate=True,
    )
    iso_sigma: float = setting(
        0.005,
        "Standard deviation of the isotropic noise of genetic variation (Eq. 6).",
        low=0.0,
        high=100.0,
        symbol="sigma_1",
        rate=True,
        part="genetic",
    )
    line_sigma: float = setting(
        0.05,
        "Standard deviation of the step along the line between two parents (Eq. 6).",
        low=0.0,
        high=100.0,
        symbol="sigma_2",
        rate=True,
        part="genetic",
    )
    n_grad: int = setting(
        0,
        "Policy gradient steps per offspring; 0: the algorithm's own number (Table 1: 10).",
        low=0,
        high=10_000,
        own=True,
        unit="steps",
        symbol="n_grad",
        rate=True,
        part="gradients",
    )
    pg_learning_rate: float = setting(
        -1.0,
        "Adam learning rate of policy gradient variation; -1: the algorithm's own (Table 1: 0.001).",
        low=-1.0,
        high=10.0,
        own=True,
        rate=True,
        part="gradients",
    )
    n_crit: int = setting(
        0,
        "Critic training steps per generation; 0: the algorithm's own number (Table 1: 300).",
        low=0,
        high=1_000_000,
        own=True,
        unit="steps",
        symbol="n_crit",
        rate=True,
        part="critics",
    )
    critic_learning_rate: float = setting(
        3e-4, "Adam learning rate of the critics.", low=0.0, high=10.0, rate=True, part="critics"
    )
    greedy_learning_rate: float = setting(
        3e-4,
        "Adam learning rate of the greedy controller.",
        low=0.0,
        high=10.0,
        rate=True,
        part="critics",
    )
    discount: float = setting(
        0.99, "Discount factor.", low=0.0, high=1.0, symbol="gamma", rate=True, part="critics"
    )
    target_rate: float = setting(
        0.005,
        "Share of the networks that moves into their targets (Eq. 4).",
        low=0.0,
        high=1.0,
        symbol="tau",
        rate=True,
        part="critics",
    )
    smoothing_sigma: float = setting(
        0.2,
        "Standard deviation of the smoothing noise on target actions.",
        low=0.0,
        high=10.0,
        symbol="sigma_p",
        rate=True,
        part="critics",
    )
    smoothing_clip: float = setting(
        0.5,
        "Greatest magnitude of the smoothing noise.",
        low=0.0,
        high=10.0,
        symbol="c",
        rate=True,
        part="critics",
    )
    target_period: int = setting(
        2,
        "Critic steps per update of the greedy controller and the targets.",
        low=1,
        high=1_000_000,
        unit="steps",
        symbol="d",
        rate=True,
        part="critics",
    )

    transition_batch: int = setting(
        0,
        "Transitions per training batch; 0: the algorithm's own number (Table 1: 256).",
        low=0,
        high=1_000_000,
        unit="transitions",
        symbol="N",
        part="critics",
        own=True,
    )
    replay_size: int = setting(
        0,
        "Transitions that the replay buffer holds, first in first out; 0: the algorithm's own number.",
        low=0,
        high=100_000_000,
        unit="transitions",
        part="critics",
        own=True,
    )
