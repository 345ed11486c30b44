"""The outcome of an episode, next to what the repertoire promised."""

from __future__ import annotations

from typing import Any

import numpy as np

from pga_me_ros.player.gait import Gait
from pga_me_ros.tasks.rollout import Episode


def is_kept(gait: Gait, episode: Episode) -> bool:
    """Whether fitness and descriptor are those promised, bit for bit."""
    same = np.array_equal(episode.descriptor, gait.descriptor)
    return episode.fitness == gait.fitness and same


def kept(gait: Gait, episode: Episode) -> str:
    """Return what was achieved and what was promised, in one line."""
    achieved = _words(episode.fitness, episode.descriptor)
    promised = _words(gait.fitness, gait.descriptor)
    verdict = "equal" if is_kept(gait, episode) else "different"
    return f"achieved {achieved}; promised {promised}: {verdict}"


def _words(fitness: float, descriptor: Any) -> str:
    return f"fitness {fitness:.2f}, descriptor [{', '.join(f'{x:.3f}' for x in descriptor)}]"
