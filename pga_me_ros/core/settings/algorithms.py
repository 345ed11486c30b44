"""Settings that a single algorithm uses; the others refuse them."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.extraction import ExtractionSettings
from pga_me_ros.core.settings.field import setting


@dataclass(frozen=True)
class AlgorithmSettings(ExtractionSettings):
    """A block per algorithm; each description begins with the algorithm's name."""

    exploration_sigma: float = setting(
        0.1,
        "td3: standard deviation of the Gaussian noise on the actor's actions, which are then clipped to their limits.",
        low=0.0,
        high=10.0,
        symbol="sigma_a",
        part="td3",
    )
    exploration_correlation: float = setting(
        0.0,
        "td3: correlation of that noise from one step to the next; 0: independent, as published. A high one moves "
        "limbs where independent noise averages out.",
        low=0.0,
        high=0.999,
        part="td3",
    )
    es_samples: int = setting(
        1000,
        "map_elites_es: evaluations per estimate of a gradient, in mirrored pairs; section 4.3.",
        low=2,
        high=99_998,
        unit="evaluations",
        part="map_elites_es",
    )
    es_sigma: float = setting(
        0.02,
        "map_elites_es: standard deviation of the samples around their center, in each parameter.",
        low=1e-9,
        high=100.0,
        symbol="sigma",
        part="map_elites_es",
    )
    es_learning_rate: float = setting(
        0.01,
        "map_elites_es: Adam learning rate of its steps.",
        low=0.0,
        high=10.0,
        part="map_elites_es",
    )
    es_l2: float = setting(
        0.005,
        "map_elites_es: share of the center that is taken off the gradient (weight decay).",
        low=0.0,
        high=10.0,
        part="map_elites_es",
    )
    es_steps: int = setting(
        10,
        "map_elites_es: steps up the fitness, then as many up the novelty, each time from an elite.",
        low=1,
        high=1_000_000,
        unit="generations",
        symbol="n_optim_gens",
        part="map_elites_es",
    )
    es_neighbors: int = setting(
        10,
        "map_elites_es: nearest behaviors whose mean distance is the novelty of one.",
        low=1,
        high=1_000_000,
        unit="behaviors",
        symbol="k",
        part="map_elites_es",
    )
    es_cell_sampling: str = setting(
        "biased",
        "map_elites_es, where steps start: 'biased' to the fittest elite or the fitter of recent ones (exploit) and to "
        "the most novel (explore), or 'plain', half from the fittest and half from any.",
        choices=("biased", "plain"),
        part="map_elites_es",
    )
    injection_share: float = setting(
        0.5,
        "dcrl_map_elites: share of the offspring not made by GA that are the actor itself, asked for an elite's "
        "descriptor; the others are made by policy gradients.",
        low=0.0,
        high=1.0,
        part="dcrl_map_elites",
    )
    similarity_length: float = setting(
        0.1,
        "dcrl_map_elites: distance between the intended and the achieved descriptor, both scaled to -1..1, at which a "
        "reward counts 1/e of its full value.",
        low=1e-6,
        high=1e6,
        symbol="l",
        part="dcrl_map_elites",
    )
    novelty_neighbors: int = setting(
        5,
        "qd_rl: nearest neighbors whose mean distance is the novelty of an elite, and of a state.",
        low=1,
        high=10_000,
        unit="neighbors",
        symbol="k",
        part="qd_rl",
    )
    state_archive_size: int = setting(
        10_000,
        "qd_rl: state descriptors that the novelty of a state is measured against, first in first out.",
        low=1,
        high=1_000_000,
        unit="descriptors",
        part="qd_rl",
    )
    state_spacing: float = setting(
        0.1,
        "qd_rl: distance, in shares of the descriptor's range, that a state descriptor must be away from all in that "
        "archive to enter it; 0 lets all enter.",
        low=0.0,
        high=1.0,
        part="qd_rl",
    )
