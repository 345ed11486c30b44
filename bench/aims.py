"""What came of a generation of DCRL-MAP-Elites: who earned what, and how far it missed the descriptor it was meant for.

Run: `.venv/bin/python bench/aims.py RUN [--generation 31] [--length 0.1]`; a line per operator. The run has to be here
with its experience, which is kept for the newest generations. Distances are between descriptors scaled to -1..1, as the
similarity takes them: it weighs the rewards that the critics learn from.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.algorithms.dcrl.similarity import similarity
from pga_me_ros.core.networks.conditioned import scaled
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.tasks.registry import make_task


def main() -> None:
    """Print a line per operator."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="run directory")
    parser.add_argument("--generation", type=int, help="generation; by default the newest")
    parser.add_argument("--length", type=float, help="similarity_length; by default the run's")
    args = parser.parse_args()
    with Repertoire.open(args.run / "repertoire.db", read_only=True) as repertoire:
        generation = repertoire.last_generation if args.generation is None else args.generation
        settings = Settings.from_stored(repertoire.info.settings)
        settings = settings.with_rates(repertoire.generation(generation).rates)
    if generation < settings.init_generations:
        parser.error(
            f"generation {generation} was meant for no descriptors; those from {settings.init_generations} on are"
        )
    if args.length is not None:
        settings = settings.replace(similarity_length=args.length)
    spec = make_task(settings.task).spec
    episodes = Experience(args.run / "experience", settings).episodes(generation)
    for slots in algorithm_of(settings).batch_plan(settings, generation):
        own = episodes[slots.first : slots.first + slots.count]
        steps = sum(e.length for e in own)
        line = (
            f"{slots.operator.name:16} fitness {np.mean([e.fitness for e in own]):7.1f}, "
            f"{sum(e.fitness for e in own) / steps:.2f} a step of {steps / len(own):.0f}; "
            f"actions change by {np.mean([_change(e.actions) for e in own]):.3f} a step"
        )
        aimed = [e for e in own if e.intended is not None]
        if aimed:
            achieved = scaled([e.descriptor for e in aimed], spec)
            aims = scaled([e.intended for e in aimed], spec)
            missed = np.linalg.norm(achieved - aims, axis=1)
            counts = similarity(achieved, aims, settings.similarity_length).mean()
            line += f"; misses its aim by {np.median(missed):.2f}, rewards count {counts:.4f}"
        print(line)


def _change(actions: np.ndarray) -> float:
    return float(np.abs(np.diff(actions, axis=0)).mean()) if len(actions) > 1 else 0.0


if __name__ == "__main__":
    main()
