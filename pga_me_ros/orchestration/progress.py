"""The progress of a run: a topic for programs, and a line of text for people."""

from __future__ import annotations

import math
import os
import socket
import time
from collections import deque

from pga_me_msgs.msg import Metrics, Progress

from pga_me_ros.core.settings import Settings
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.time_left import TimeLeft
from pga_me_ros.ros import names, qos

WINDOW = 20
"""Number of latest generations that the rate is averaged over."""

AT_WORK = ("running", "re-evaluating")
"""States in which evaluations are done."""

ENDS = ("finished", "stopping", "failed")
"""States that end the progress line."""


class ProgressReporter:
    """Publishes `Progress` and prints it.

    Until `begin`, its message claims the orchestrator's name, stamped with the time of the claim.

    Args:
        control: The orchestrator's node.
    """

    def __init__(self, control: Control) -> None:
        self._control = control
        self.msg = Progress(
            state="starting", generation=-1, host=socket.gethostname(), pid=os.getpid()
        )
        self.msg.stamp = control.get_clock().now().to_msg()
        self.msg.max_fitness = self.msg.eta = math.nan
        self._publisher = control.create_publisher(Progress, names.PROGRESS, qos.LATCHED)
        self._times: deque[tuple[float, int]] = deque(maxlen=WINDOW + 1)
        self._time_left = TimeLeft(0, 0, 0)
        self._batch_size = 1
        self._first_later = 0

    def begin(self, run_id: str, settings: Settings, max_steps: int) -> None:
        """Start to report a run.

        Args:
            run_id: Id of the run.
            settings: Its settings.
            max_steps: Maximum steps of an episode.
        """
        self.msg.run_id, self.msg.task = run_id, settings.task
        self._batch_size, self._first_later = settings.batch_size, settings.init_generations
        self._time_left = TimeLeft(
            settings.init_generations, settings.generations, settings.batch_size * max_steps
        )
        self.msg.generations = settings.generations
        self.msg.budget = settings.generations * settings.batch_size
        self.publish()

    def starting(self, up: int, total: int) -> None:
        """Show how many of the run's nodes are up, where a line can be overwritten."""
        if self._control.terminal.in_place:
            self._control.terminal.show([self.msg.task, f"{up} of {total} nodes are up"])

    def enter(self, state: str) -> None:
        """Report that the run has entered a state."""
        if state in AT_WORK and self.msg.state != state:
            self._times.clear()
            self._times.append((time.monotonic(), self._done))
        if state in ENDS:
            self._control.terminal.close()
        self.msg.state = state
        self.publish()

    def generation(self, metrics: Metrics, *, finished: bool = True) -> None:
        """Report the archive after a generation.

        Args:
            metrics: Its metrics.
            finished: Whether the generation was finished just now, rather than before the run was resumed.
        """
        msg = self.msg
        msg.generation, msg.evaluations = metrics.generation, metrics.evaluations
        msg.cells, msg.coverage = metrics.cells, metrics.coverage
        msg.qd_score, msg.max_fitness = metrics.qd_score, metrics.max_fitness
        if finished:
            self._note_generation(metrics)
            self._control.terminal.show(self.parts())
        self.publish()

    def reevaluated(self, done: int, total: int) -> None:
        """Report the progress of the final re-evaluation of the elites.

        Args:
            done: Re-evaluations done since this start.
            total: Re-evaluations that were missing at this start.
        """
        self.msg.final_reevaluations, self.msg.final_budget = done, total
        self.enter("re-evaluating")
        if self._measure():
            self.msg.eta = self._left / self.msg.rate
        else:
            self.msg.eta = self._time_left.seconds(
                self.msg.generation + 1, total / self._batch_size
            )
        self._control.terminal.show(self.parts())
        self.publish()

    def publish(self) -> None:
        """Publish the current state."""
        if self.msg.run_id:
            self.msg.stamp = self._control.get_clock().now().to_msg()
        self._publisher.publish(self.msg)

    def say(self, text: str) -> None:
        """Print a separate line."""
        self._control.terminal.say(text)

    def parts(self) -> list[str]:
        """Return the parts of the progress line, most important first: a narrow terminal drops the last ones."""
        m = self.msg
        if m.state == "re-evaluating":
            return [
                m.task,
                f"re-evaluations {m.final_reevaluations}/{m.final_budget}",
                f"ETA {_duration(m.eta)}",
                f"{m.rate:.1f}/s",
            ]
        return [
            m.task,
            f"evaluations {m.evaluations}/{m.budget}",
            f"coverage {m.coverage}/{m.cells}",
            f"ETA {_duration(m.eta)}",
            f"best {m.max_fitness:.0f}",
            f"QD-score {m.qd_score:.0f}",
            f"{m.rate:.1f}/s",
            f"generation {m.generation + 1}/{m.generations}",
        ]

    @property
    def _done(self) -> int:
        """Evaluations done so far, final re-evaluations included."""
        return int(self.msg.evaluations + self.msg.final_reevaluations)

    @property
    def _left(self) -> int:
        """Re-evaluations left to do."""
        return int(self.msg.final_budget - self.msg.final_reevaluations)

    def _note_generation(self, metrics: Metrics) -> None:
        """Update rate and remaining time from the generations so far."""
        msg = self.msg
        began, _ = self._times[-1]
        if msg.generation == self._first_later:
            self._times = deque(
                [self._times[-1]], maxlen=WINDOW + 1
            )  # random controllers are quick
        self._measure()
        self._time_left.note(msg.generation, self._times[-1][0] - began, metrics.steps)
        elites = self._control.options.reevaluations * msg.coverage / self._batch_size
        msg.eta = self._time_left.seconds(msg.generation + 1, elites)

    def _measure(self) -> bool:
        """Update the rate from the last generations or re-evaluations; return whether it is known."""
        msg = self.msg
        self._times.append((time.monotonic(), self._done))
        (t0, n0), (t1, n1) = self._times[0], self._times[-1]
        if not (t1 > t0 and n1 > n0):
            return False
        msg.rate = (n1 - n0) / (t1 - t0)
        return True


def _duration(seconds: float) -> str:
    if math.isnan(seconds):
        return "?"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
