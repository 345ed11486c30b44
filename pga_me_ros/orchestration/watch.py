"""The orchestrator's entries in /diagnostics about itself and its team."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from pga_me_msgs.msg import Progress

from pga_me_ros.orchestration.children import Children
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.evaluator_pool import EvaluatorPool
from pga_me_ros.orchestration.roster import Roster
from pga_me_ros.ros.diagnostics import Diagnostics, silent


class Watch:
    """Publishes the health of the run and its children.

    Args:
        control: The orchestrator's node.
        children: The run's child processes.
        roster: Which of them have been heard from.
        pool: Its evaluators.
        run_id: Id of the run.
    """

    def __init__(
        self,
        control: Control,
        children: Children,
        roster: Roster,
        pool: EvaluatorPool,
        run_id: str,
    ) -> None:
        self._children = children
        self._roster = roster
        self._pool = pool
        self._diagnostics = Diagnostics(control)
        self._diagnostics.run_id = run_id
        self._restarts = 0

    def failed(self, reason: str) -> None:
        """Note why the run cannot continue."""
        self._diagnostics.fault(reason)

    def publish(self, progress: Progress) -> None:
        """Publish the run's health, and which children are silent; to be called once a second."""
        if self._children.restarts > self._restarts:
            self._restarts = self._children.restarts
            self._diagnostics.disturbance("a node died and was restarted")
        self._diagnostics.queue = self._pool.waiting
        more = {
            "state": progress.state,
            "generation": progress.generation,
            "evaluators": len(self._pool),
            "restarts": self._restarts,
            "re-evaluations": progress.reevaluations,
        }
        self._diagnostics.publish(progress.evaluations, self._roster.refused, more, self._silent())

    def _silent(self) -> list[DiagnosticStatus]:
        """Return entries about children that have gone silent."""
        return [
            silent(self._roster.prefix + name, self._diagnostics.run_id, seconds)
            for name, seconds in self._roster.stale().items()
        ]
