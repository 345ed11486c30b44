"""Adaptations as messages, and back."""

from __future__ import annotations

import math

from pga_me_msgs.msg import AdaptationEstimate, AdaptationTrial

from pga_me_ros.core.adaptation.adaptation import Adaptation, Trial
from pga_me_ros.ros.convert import flat


def trial_to_msg(trial: Trial) -> AdaptationTrial:
    """Return a trial as a message."""
    return AdaptationTrial(
        number=trial.number,
        cell=trial.cell,
        evaluation=trial.evaluation,
        descriptor=flat(trial.descriptor, "d"),
        promised=trial.promised,
        expected=trial.expected,
        uncertainty=trial.uncertainty,
        achieved=math.nan if trial.achieved is None else trial.achieved,
        given_up=trial.given_up,
    )


def state_of(adaptation: Adaptation) -> str:
    """Return the state of an adaptation in a word: ``running``, ``adapted`` or ``spent``."""
    if not adaptation.over:
        return "running"
    return "adapted" if adaptation.adapted else "spent"


def estimate_to_msg(adaptation: Adaptation) -> AdaptationEstimate:
    """Return what is expected of each behavior, and the trials; run, task and stamp are left open."""
    p, best = adaptation.promises, adaptation.best
    means, deviations = adaptation.estimate
    msg = AdaptationEstimate(
        state=state_of(adaptation),
        budget=adaptation.settings.budget,
        trials=[trial_to_msg(trial) for trial in adaptation.trials],
        best=best.number if best else 0,
    )
    msg.cells = flat(p.cells, "q")
    msg.descriptors = flat(p.descriptors, "d")
    msg.promised = flat(p.fitness, "d")
    msg.expected = flat(means, "d")
    msg.uncertainty = flat(deviations, "d")
    return msg
