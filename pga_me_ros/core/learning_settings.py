"""Settings of variation and of critic training: Table 1 of Nilsson & Cully (2021)."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.run_settings import RunSettings
from pga_me_ros.core.setting_field import setting


@dataclass(frozen=True)
class LearningSettings(RunSettings):
    """How offspring are made and how critics are trained; most of it may change from generation to generation."""

    n_evo: int = setting(
        50,
        "Offspring per generation by genetic variation; batch_size makes it standard MAP-Elites, 0 PG only.",
        low=0,
        high=100_000,
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
    )
    line_sigma: float = setting(
        0.05,
        "Standard deviation of the step along the line between two parents (Eq. 6).",
        low=0.0,
        high=100.0,
        symbol="sigma_2",
        rate=True,
    )
    n_grad: int = setting(
        10,
        "Policy gradient steps per offspring.",
        low=1,
        high=10_000,
        unit="steps",
        symbol="n_grad",
        rate=True,
    )
    pg_learning_rate: float = setting(
        0.001, "Adam learning rate of policy gradient variation.", low=0.0, high=10.0, rate=True
    )
    n_crit: int = setting(
        300,
        "Critic training steps per generation; td3 takes one per control step of the last generation instead.",
        low=1,
        high=1_000_000,
        unit="steps",
        symbol="n_crit",
        rate=True,
    )
    critic_learning_rate: float = setting(
        3e-4, "Adam learning rate of the critics.", low=0.0, high=10.0, rate=True
    )
    greedy_learning_rate: float = setting(
        3e-4, "Adam learning rate of the greedy controller.", low=0.0, high=10.0, rate=True
    )
    discount: float = setting(
        0.99, "Discount factor.", low=0.0, high=1.0, symbol="gamma", rate=True
    )
    target_rate: float = setting(
        0.005,
        "Share of the networks that moves into their targets (Eq. 4).",
        low=0.0,
        high=1.0,
        symbol="tau",
        rate=True,
    )
    smoothing_sigma: float = setting(
        0.2,
        "Standard deviation of the smoothing noise on target actions.",
        low=0.0,
        high=10.0,
        symbol="sigma_p",
        rate=True,
    )
    smoothing_clip: float = setting(
        0.5, "Greatest magnitude of the smoothing noise.", low=0.0, high=10.0, symbol="c", rate=True
    )
    target_period: int = setting(
        2,
        "Critic steps per update of the greedy controller and the targets.",
        low=1,
        high=1_000_000,
        unit="steps",
        symbol="d",
        rate=True,
    )

    transition_batch: int = setting(
        256,
        "Transitions per training batch.",
        low=1,
        high=1_000_000,
        unit="transitions",
        symbol="N",
    )
    replay_size: int = setting(
        1_000_000,
        "Transitions that the replay buffer holds, first in first out.",
        low=1,
        high=100_000_000,
        unit="transitions",
    )
