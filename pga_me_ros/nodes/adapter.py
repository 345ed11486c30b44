"""Adapter: chooses which behavior of a repertoire a damaged robot tries next, and remembers what came of it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

from pga_me_msgs.msg import AdaptationEstimate
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import GetAdaptation, GetBehavior, NextTrial, ReportTrial, StartAdaptation

from pga_me_ros.adapting.memory import Memory, Undertaking, lock
from pga_me_ros.adapting.messages import estimate_to_msg, trial_to_msg
from pga_me_ros.adapting.repertoire_link import RepertoireLink
from pga_me_ros.adapting.run_worlds import RunWorlds
from pga_me_ros.core.adaptation.adaptation import Adaptation, Trial
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.field import setting
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.namesakes import STOP_OR_MOVE, leave_to_elders
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import run_node
from pga_me_ros.ros.spinning import EndingNode


@dataclass(frozen=True)
class AdapterSettings:
    """Parameters of the adapter besides those of `AdaptationSettings`."""

    memory: str = setting(
        "adaptations.db",
        "SQLite file with all trials of one robot, from which an adaptation is continued after a restart.",
        path=True,
    )
    worlds: str = setting(
        "",
        "Folder of the repertoire's run, or zoo/NAME, whose re-evaluations in other worlds (reevaluate RUN "
        "--randomization TEXT) tell what behaviors achieve there: worlds that the robot may be in; empty: none.",
        path=True,
    )


class Adapter(GraphNode):
    """One robot that adapts. The repertoire is asked through a second node, which nobody spins in the meantime."""

    def __init__(self) -> None:
        super().__init__("adapter")
        values = declare(self, AdapterSettings, AdaptationSettings, shared=(Settings, RunOptions))
        own = {f.name for f in fields(AdapterSettings)}
        self._settings = AdaptationSettings(
            **{name: value for name, value in values.items() if name not in own}
        )
        self._worlds = RunWorlds.load(values["worlds"]) if values["worlds"] else None
        memory = Path(values["memory"])
        self._memory, self._lock = Memory(memory), lock(memory)
        self._asking = EndingNode(
            f"{self.get_name()}_asks", namespace=self.get_namespace(), context=self.context
        )
        self._repertoire = RepertoireLink(self._asking)
        self._adaptation: Adaptation | None = None
        self._undertaking: Undertaking | None = None
        self._changed = False
        self._topic = self.create_publisher(AdaptationEstimate, names.ADAPTATION, qos.LATCHED)
        self.create_subscription(MetricsMsg, names.METRICS, self._hear, qos.LATCHED)
        many = qos.ASKED_BY_MANY
        self.serve(StartAdaptation, names.START_ADAPTATION, self._start, "ok", many)
        self.serve(NextTrial, names.NEXT_TRIAL, self._next, "ok", many)
        self.serve(ReportTrial, names.REPORT_TRIAL, self._report, "ok", many)
        self.serve(GetAdaptation, names.ADAPTATION_STATUS, self._status_of, "ok", many)
        leave_to_elders(self, lambda msg: msg.kind == "adapter", STOP_OR_MOVE)
        self.start_heartbeat()

    def _hear(self, metrics: MetricsMsg) -> None:
        """Note that the repertoire has changed since it was listed."""
        self._changed = True

    def _start(self, request: StartAdaptation.Request, response: StartAdaptation.Response) -> None:
        budget = self._settings.budget if request.budget == -1 else request.budget
        if budget < 1:
            raise RequestError(f"budget is {budget}; give at least 1 trial, or -1 for the default.")
        info = self._repertoire.info()
        wanted = Undertaking(
            info.run_id, info.task, budget, request.min_fitness, request.max_fall_share
        )
        adaptation = None if request.anew else self._continued(wanted)
        if adaptation:
            response.message = f"Continues after {len(adaptation.trials)} trials."
        else:
            adaptation = self._of(wanted, [])
            self._take(self._memory.start(wanted), adaptation)
        self._answer_start(response, adaptation)

    def _continued(self, wanted: Undertaking) -> Adaptation | None:
        """Return the last adaptation with another budget; None if it is over, or of another repertoire.

        Raises:
            RequestError: It is under way with other limits than those wanted.
        """
        before = self._memory.last()
        if before is None or before[0].run_id != wanted.run_id:
            return None
        undertaking, trials = replace(before[0], budget=wanted.budget), before[1]
        adaptation = self._of(undertaking, trials)
        if adaptation.over:
            return None
        if wanted.limits != undertaking.limits:
            raise RequestError(
                f"An adaptation with {undertaking.limits_in_words} is under way, but {wanted.limits_in_words} is "
                "asked for; ask for the same, or set anew to forget it."
            )
        self._memory.change_budget(undertaking)
        self._take(undertaking, adaptation)
        return adaptation

    def _answer_start(self, response: StartAdaptation.Response, adaptation: Adaptation) -> None:
        response.run_id = self._undertaking.run_id if self._undertaking else ""
        response.candidates = len(adaptation.promises.cells)
        response.trials = len(adaptation.trials)
        self._publish()

    def _next(self, request: NextTrial.Request, response: NextTrial.Response) -> None:
        adaptation, undertaking = self._under_way()
        while True:
            known = len(adaptation.trials)
            trial = adaptation.next()
            if trial and len(adaptation.trials) > known:
                self._store(undertaking, trial)
            answer = self._behavior_of(trial, with_controller=request.with_controller)
            if trial is None or answer:
                break
            # A fitter one took its cell before it could be tried.
            self._store(undertaking, adaptation.give_up())
            self._refresh(adaptation, undertaking)
        if trial is None:
            response.over, response.adapted = True, adaptation.adapted
            response.message = (
                "The best trial achieved what is to be expected."
                if adaptation.adapted
                else "The budget is spent, or nothing is left to try."
            )
            trial = adaptation.best
            answer = self._behavior_of(trial, with_controller=request.with_controller)
        if trial:
            response.trial = trial_to_msg(trial)
        if answer:
            response.behavior, response.controller = answer.behavior, answer.controller
        self._publish()

    def _behavior_of(
        self, trial: Trial | None, *, with_controller: bool
    ) -> GetBehavior.Response | None:
        """Return the answer with the behavior of a trial, None if the repertoire has it no longer."""
        if trial is None:
            return None
        answer = self._repertoire.behavior(trial.cell, with_controller=with_controller)
        fits = answer.found and answer.behavior.evaluation == trial.evaluation
        return answer if fits else None

    def _report(self, request: ReportTrial.Request, response: ReportTrial.Response) -> None:
        adaptation, undertaking = self._under_way()
        if request.give_up:
            trial = adaptation.give_up(request.trial)
        else:
            trial = adaptation.report(request.fitness, request.trial)
        self._store(undertaking, trial)
        response.over = adaptation.over
        self.count_done()
        self._publish()

    def _store(self, undertaking: Undertaking, trial: Trial) -> None:
        """Write a trial into the memory; if that fails, only what the file says counts, so a request may be repeated.

        Raises:
            StorageError: The file cannot be written.
        """
        try:
            self._memory.store(undertaking, trial)
        except StorageError:
            self._adaptation = None
            raise

    def _status_of(self, _: GetAdaptation.Request, response: GetAdaptation.Response) -> None:
        if self._adaptation is None and self._memory.last():
            self._under_way()
        response.estimate = self._estimate()

    def _under_way(self) -> tuple[Adaptation, Undertaking]:
        """Return the present adaptation, with the repertoire as it is now; after a restart, that of the memory.

        Raises:
            RequestError: None was started, or it is of another repertoire.
            RepertoireTimeoutError: Nobody serves the repertoire.
        """
        if self._adaptation is None or self._undertaking is None:
            before = self._memory.last()
            if before is None:
                raise RequestError(f"No adaptation was started; call {names.START_ADAPTATION}.")
            undertaking, trials = before
            info = self._repertoire.info()
            if info.run_id != undertaking.run_id:
                raise RequestError(
                    f"The last adaptation was of the repertoire of run {undertaking.run_id}, but run {info.run_id} is "
                    f"served; serve that one, or call {names.START_ADAPTATION}."
                )
            self._take(undertaking, self._of(undertaking, trials))
        assert self._adaptation is not None
        assert self._undertaking is not None
        if self._changed:
            self._refresh(self._adaptation, self._undertaking)
        return self._adaptation, self._undertaking

    def _of(self, undertaking: Undertaking, trials: list[Trial]) -> Adaptation:
        """Return an adaptation to the repertoire as it is now."""
        settings = replace(self._settings, budget=undertaking.budget)
        worlds = self._worlds.of(undertaking.run_id) if self._worlds else None
        return Adaptation(self._repertoire.promises(undertaking), settings, trials, worlds=worlds)

    def _refresh(self, adaptation: Adaptation, undertaking: Undertaking) -> None:
        """List the repertoire again."""
        info = self._repertoire.info()
        if info.run_id != undertaking.run_id:
            raise RequestError(
                f"Run {info.run_id} is served now, but the adaptation is of run {undertaking.run_id}; call "
                f"{names.START_ADAPTATION}."
            )
        adaptation.promises = self._repertoire.promises(undertaking)
        self._changed = False

    def _take(self, undertaking: Undertaking, adaptation: Adaptation) -> None:
        """Go on with an adaptation whose repertoire has just been listed."""
        self._undertaking, self._adaptation = undertaking, adaptation
        self._changed = False

    def _estimate(self) -> AdaptationEstimate:
        if self._adaptation is None or self._undertaking is None:
            msg = AdaptationEstimate(state="none")
        else:
            msg = estimate_to_msg(self._adaptation)
            msg.run_id, msg.task = self._undertaking.run_id, self._undertaking.task
        msg.stamp = self.get_clock().now().to_msg()
        return msg

    def _publish(self) -> None:
        self._topic.publish(self._estimate())

    def destroy_node(self) -> None:
        """Close the memory, then destroy both nodes."""
        self._memory.close()
        self._lock.release()
        self._asking.destroy_node()
        super().destroy_node()


PROGRAM = Program(
    "adapter",
    "Chooses which behavior of a repertoire a damaged robot tries next: /adapt/start, next, report and status.",
    (AdapterSettings, AdaptationSettings),
)


def main() -> int:
    """Run the adapter."""
    return run_node(PROGRAM, Adapter)


if __name__ == "__main__":
    raise SystemExit(main())
