"""Compares the outcome of an episode with the repertoire's promise."""

from __future__ import annotations

from typing import Any

import numpy as np

from pga_me_ros.player.gait import Gait
from pga_me_ros.tasks.rollout import Episode


def is_kept(gait: Gait, episode: Episode) -> bool:
    """Whether fitness and descriptor equal those of the behavior's original evaluation, bit for bit."""
    same = np.array_equal(episode.descriptor, gait.descriptor)
    return episode.fitness == gait.fitness and same


def kept(gait: Gait, episode: Episode, *, fresh: bool = False) -> str:
    """Return the achieved and the promised outcome in one line.

    Args:
        gait: The behavior.
        episode: The episode.
        fresh: Whether it began in another pose than the original evaluation. If so, a behavior chosen by its means
            promises these means.
    """
    achieved = _words(episode.fitness, episode.descriptor)
    if fresh and gait.by_mean:
        away = float(np.linalg.norm(episode.descriptor - gait.promised_descriptor))
        return (
            f"achieved {achieved}; promised {average(gait)}: fitness "
            f"{episode.fitness - gait.promised_fitness:+.2f}, descriptor {away:.3f} away"
        )
    promised = _words(gait.fitness, gait.descriptor)
    verdict = "equal" if is_kept(gait, episode) else "different"
    return f"achieved {achieved}; promised {promised}: {verdict}"


def lasted(episode: Episode, period: float) -> str:
    """Return how long an episode lasted, and how it ended, in words.

    Args:
        episode: The episode.
        period: Control period, s.
    """
    seconds = episode.length * period
    if episode.terminated:
        return f"fell after {seconds:.1f} s"
    return f"went on for {seconds:.1f} s, until the time was up"


def average(gait: Gait) -> str:
    """Return a behavior's mean outcome in words, or its single evaluation if it was not chosen by means."""
    if not gait.by_mean:
        return f"{_words(gait.fitness, gait.descriptor)} by a single evaluation"
    spread = f" ± {gait.fitness_spread:.2f}" if gait.repeats > 1 else ""
    numbers = ", ".join(f"{x:.3f}" for x in gait.promised_descriptor)
    return (
        f"fitness {gait.promised_fitness:.2f}{spread}, descriptor [{numbers}] on average of {gait.repeats} "
        f"re-evaluations, {100.0 * gait.fall_share:.0f} % of them falls"
    )


def _words(fitness: float, descriptor: Any) -> str:
    return f"fitness {fitness:.2f}, descriptor [{', '.join(f'{x:.3f}' for x in descriptor)}]"
