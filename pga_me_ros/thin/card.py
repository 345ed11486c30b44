"""The card of a thinned repertoire: how it was made, what it is good for and what not, from the run's own records."""

from __future__ import annotations

import math
import shlex
import statistics
from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import pairwise
from typing import Any

import numpy as np

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import CorrectedMetrics, corrected_metrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.runs.stored_actor import StoredActor
from pga_me_ros.core.storage.rows import Generation
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.yaml_files import parameter, parameter_word

PAUSE = 10.0
"""How many times as long as the median generation a generation takes that was interrupted."""

SELDOM = 0.05
"""Share of falls up to which a behavior counts as one that seldom falls."""

STEADY = "(standard deviation within a behavior)"

MEASURES = (
    ("behaviors", "elites", "{:,.0f}"),
    ("re-evaluations of each, at least", "repeats", "{:,.0f}"),
    ("mean fitness", "mean_fitness", "{:,.1f}"),
    ("best mean fitness", "max_fitness", "{:,.1f}"),
    ("fitness found with minus mean fitness", "fitness_difference", "{:,.1f}"),
    ("distance from descriptor found with to mean descriptor", "descriptor_error", "{:.3f}"),
    (f"reproducibility of fitness {STEADY}", "fitness_spread", "{:,.1f}"),
    (f"reproducibility of the descriptor {STEADY}", "descriptor_spread", "{:.3f}"),
    ("share of episodes that end in a fall", "fall_share", "{:.1%}"),
)
"""Rows of the table of measures: what it is, its field of `CorrectedMetrics`, how it is written."""


def card(
    name: str,
    run: StoredRun,
    kept: Archive,
    known: Statistics,
    measured: tuple[CorrectedMetrics, CorrectedMetrics],
    command: str,
    remark: str = "",
    actor: StoredActor | None = None,
) -> str:
    """Return a card as Markdown.

    Args:
        name: Name of the repertoire.
        run: The run that it comes from.
        kept: The thinned archive.
        known: Statistics of its elites.
        measured: Measures of the run's archive, and of the thinned one.
        command: Command line that thinned it.
        remark: What else is to be said, such as the machine.
        actor: The actor that comes with it, None for none.
    """
    return "\n".join(
        [
            f"# {name}: {len(kept)} behaviors of {run.spec.name}",
            "",
            *_origin(run, len(kept)),
            *([remark, ""] if remark else []),
            "## What they do on average",
            "",
            *_measures(run, kept, measured),
            "## Good for",
            "",
            *_good_for(run, kept, known, actor),
            "## Not for",
            "",
            *_not_for(run, kept, known),
            "## Made by",
            "",
            *_commands(run, measured[0].repeats, command),
        ]
    )


def _origin(run: StoredRun, count: int) -> Iterator[str]:
    last, settings = run.metrics[-1], run.settings
    took = (
        f" in {len(run.generations):,} generations, {duration(run.generations)} (pauses left out)"
    )
    yield (
        f"Grown by {algorithm_of(settings).title}, seed {settings.seed}: {last.evaluations:,} evaluations"
        f"{'' if run.is_thinned else took}, begun {run.info.created[:10]}. Run {run.info.run_id}."
    )
    yield f"Libraries: {', '.join(f'{k} {v}' for k, v in sorted(run.info.versions.items()))}."
    changed = {
        name: sorted({str(g.rates.get(name)) for g in run.generations})
        for name in settings.rates
        if len({str(g.rates.get(name)) for g in run.generations}) > 1
    }
    if changed:
        words = "; ".join(f"{name}: {', '.join(values)}" for name, values in changed.items())
        yield f"Rates that were changed on the way: {words}."
    elites = "behaviors that were kept of it before" if run.is_thinned else "elites"
    yield (
        f"Of its {last.coverage:,} {elites}, these {count} have the greatest mean fitness in their parts of the "
        "descriptor space."
    )
    yield ""


def _measures(
    run: StoredRun, kept: Archive, measured: tuple[CorrectedMetrics, CorrectedMetrics]
) -> Iterator[str]:
    yield "From initial poses that the run has not seen, the same ones for all:"
    yield ""
    yield f"| | {'kept before' if run.is_thinned else 'all of the run'} | these |"
    yield "|---|---|---|"
    for words, field, how in MEASURES:
        values = [getattr(m, field) for m in measured]
        texts = ["-" if math.isnan(value) else how.format(value) for value in values]
        yield f"| {words} | {texts[0]} | {texts[1]} |"
    whole = measured[0]
    yield f"| corrected coverage, corrected QD-score | {whole.coverage:,}, {whole.qd_score:,.0f} | |"
    yield ""
    for where, m in _elsewhere(run, kept):
        yield (
            f"Where {where or 'nothing'} is randomized (at least {m.repeats} re-evaluations each): mean fitness "
            f"{m.mean_fitness:,.1f}, {m.fall_share:.1%} falls, descriptor {m.descriptor_error:.3f} from the one found "
            "with."
        )
        yield ""


def _elsewhere(run: StoredRun, kept: Archive) -> Iterator[tuple[str | None, CorrectedMetrics]]:
    """Yield what was randomized in the other worlds in which all that is kept was evaluated, and the measures there."""
    for rows in run.elsewhere:
        m = corrected_metrics(kept, rows.statistics(kept))
        if m and m.elites == len(kept):
            yield rows.elsewhere, m


def _good_for(
    run: StoredRun, kept: Archive, known: Statistics, actor: StoredActor | None
) -> Iterator[str]:
    cells = kept.filled_cells()
    means = known.mean_descriptor[cells]
    covered = ", ".join(
        f"{name} {low:.2f} to {high:.2f}"
        for name, low, high in zip(
            run.spec.descriptor_names, means.min(axis=0), means.max(axis=0), strict=True
        )
    )
    yield f"- Asking for a behavior of {run.spec.name} by its descriptor: {covered}."
    seldom = int(np.count_nonzero(known.fall_share[cells] <= SELDOM))
    yield (
        f"- {seldom} of the {len(cells)} fall in at most {SELDOM:.0%} of their episodes; `max_fall_share` asks for "
        "those alone."
    )
    if actor:
        yield (
            f"- Asking one network for a behavior at every step: it holds the actor as trained for generation "
            f"{actor.generation} (`get_actor`, `export --to onnx --actor`). The measures above are not the actor's."
        )
    yield "- Starting a run from them (`start_from`), and as a controller per file (`export`)."
    yield ""


def _not_for(run: StoredRun, kept: Archive, known: Statistics) -> Iterator[str]:
    cells = kept.filled_cells()
    often = cells[known.fall_share[cells] > SELDOM]
    if len(often):
        yield (
            f"- Running any of them blindly: {len(often)} fall in more than {SELDOM:.0%} of their episodes, one of "
            f"them in {known.fall_share[often].max():.0%}. Each answer says how often (`fall_share`)."
        )
    unlike = (
        "floors, masses and motors unlike those named above, a real robot."
        if any(_elsewhere(run, kept))
        else "other floors, masses, motors, a real robot. They were "
        f"evaluated in {run.settings.task} and nowhere else."
    )
    yield (
        f"- Episodes longer than {run.spec.max_steps * run.spec.control_period:.1f} s, other starts than those of the "
        f"task, and anything that the simulation lacks: {unlike}"
    )
    yield "- Descriptors far from those above: the nearest behavior is then far, too; `max_distance` refuses it."
    yield ""


def _commands(run: StoredRun, repeats: int, command: str) -> Iterator[str]:
    given = {"task": run.settings.task, "seed": run.settings.seed, **run.settings.given}
    given["evaluations"] = run.metrics[-1].evaluations
    words = " ".join(f"-p {_word(name, value)}" for name, value in given.items())
    yield "```"
    yield f"ros2 run pga_me_ros orchestrator --ros-args {words} -p run_dir:=RUN"
    if run.is_thinned:
        yield "# then reevaluate and thin, as the card of what was kept before says; RUN is its folder from here on"
    yield f"ros2 run pga_me_ros reevaluate RUN --repeats {repeats}"
    yield command
    yield "```"
    yield ""
    yield "The same library versions on the same kind of machine give the same behaviors, bit for bit."


def _word(name: str, value: Any) -> str:
    return (
        parameter_word(name, value)
        if isinstance(value, str)
        else shlex.quote(parameter(name, value))
    )


def duration(generations: Sequence[Generation]) -> str:
    """Return how long a run took, in words, without the pauses between its sittings.

    Args:
        generations: All of its generations, at least one.
    """
    times = [datetime.fromisoformat(g.committed) for g in generations]
    steps = [(b - a).total_seconds() for a, b in pairwise(times)]
    if not steps:
        return "an unknown time"
    # A generation takes longer as robots learn to walk, so the median of those around it counts.
    total = 0.0
    for k, step in enumerate(steps):
        usual = statistics.median(steps[max(0, k - 25) : k + 26])
        total += step if step <= max(PAUSE * usual, 1.0) else usual
    minutes = round(total / 60.0)
    if minutes < 2:
        return f"{total:.0f} s"
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"
