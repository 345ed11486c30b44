"""One run from start to end: team, generation loop, progress."""

from __future__ import annotations

from collections.abc import Callable

from pga_me_msgs.msg import Metrics, NodeStatus
from pga_me_msgs.srv import GetInfo

from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.runs.run_directory import RunDirectory
from pga_me_ros.orchestration.calls import PATIENCE, LoopClients, StoppedError, Waiter, call
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.evaluator_pool import EvaluatorPool
from pga_me_ros.orchestration.evaluator_work import Job
from pga_me_ros.orchestration.final_reevaluation import FinalReevaluation
from pga_me_ros.orchestration.generation import GenerationLoop
from pga_me_ros.orchestration.progress import ProgressReporter
from pga_me_ros.orchestration.team import Team
from pga_me_ros.orchestration.trainer_client import TrainerClient
from pga_me_ros.orchestration.watch import Watch
from pga_me_ros.process.prepared_child import PreparedChild
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.dds_choices import LOCAL_NOTE, is_local
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.tasks.registry import simulation_versions
from pga_me_ros.tasks.spec import TaskSpec


class Run:
    """Grows a repertoire with a team of nodes.

    Args:
        control: The orchestrator's node; its executor must spin in another thread.
        spec: Task.
        directory: Folder of the run.
        options: How the run is carried out.
        progress: Where progress is reported.
        prepared: Processes that were started early (`EarlyStart`), by node name.

    Attributes:
        watch: Publishes the health of the run and its nodes.
    """

    def __init__(
        self,
        control: Control,
        spec: TaskSpec,
        directory: RunDirectory,
        options: RunOptions,
        progress: ProgressReporter,
        prepared: dict[str, PreparedChild],
    ) -> None:
        self._control = control
        self._directory = directory
        self._options = options
        self._progress = progress
        self._max_steps = spec.max_steps
        self._waiter = Waiter(self._look, lambda: self._team.roster.arrivals)
        settings = directory.settings
        shape = controller_shape(spec, settings)
        job = Job(
            run_id=directory.run_id,
            task=settings.task,
            seed=settings.seed,
            layer_sizes=shape.sizes,
            descriptor_dim=spec.descriptor_dim,
            versions=simulation_versions(settings.task),
            randomization=settings.randomization,
        )
        self._pool = EvaluatorPool(control, job, self._waiter.wake)
        self._team = Team(control, directory, self._pool, prepared)
        children, roster = self._team.children, self._team.roster
        self.watch = Watch(control, children, roster, self._pool, directory.run_id)
        clients = LoopClients(control)
        self._critics = TrainerClient(
            control,
            directory.run_id,
            spec,
            settings,
            clients,
            self._pool,
            self._waiter,
            lambda: self._team.children.pid("critic_trainer"),
        )
        self._loop = GenerationLoop(
            directory.run_id,
            shape,
            spec.descriptor_dim,
            clients,
            self._pool,
            self._critics,
            self._waiter,
            directory.imported,
        )
        self._final = FinalReevaluation(
            directory, options.reevaluations, self._pool, self._waiter, progress
        )
        self._clients = clients
        self._info = control.create_client(GetInfo, names.GET_INFO, qos_profile=qos.CLIENT)
        control.create_subscription(NodeStatus, names.STATUS, self._heard, qos.STATUS)

    def grow(self) -> None:
        """Do the remaining generations.

        Raises:
            StoppedError: The user stopped the run.
            PgaError: The run cannot continue.
        """
        settings = self._directory.settings
        todo = range(self._directory.next_generation, settings.generations)
        self._progress.begin(self._directory.run_id, settings, self._max_steps)
        for note in self._directory.notes:
            self._progress.say(f"note: {note}")
        self._team.start_archive(grow=bool(todo))
        if todo:
            self._team.start_learners()
        if todo or self._final.is_missing():
            self._team.start_evaluators()
        self._waiter.until(self._team.ready)
        if todo.start:
            self._progress.generation(self._metrics(), finished=False)
        if todo:
            self._wait_for_evaluators(self._clients.ready)
        before = self._directory.before
        for t in todo:
            self._wait_while_paused()
            settings = self._control.settings
            self._progress.enter("running")
            metrics = self._loop.run(settings, before, t)
            before = settings
            self._team.children.progressed()
            self._report(metrics)
        self._team.stop_learners()
        self._final.carry_out(self._wait_for_evaluators, self._wait_while_paused)
        self._team.stop_workers()
        self._progress.enter("finished")

    def serve(self) -> None:
        """Keep the archive manager running for other nodes until the user stops the run.

        Raises:
            StoppedError: The user stopped the run.
        """
        self._waiter.until(lambda: False)

    def end(self, *, at_once: bool = False) -> None:
        """Stop all children."""
        self._team.children.stop(at_once=at_once)

    @property
    def summary(self) -> str:
        """Summary of restarts, re-evaluations and refusals, as text."""
        return (
            f"{self._team.children.restarts} restarts, {self._critics.reevaluations} re-evaluations, "
            f"{self._team.roster.refused} refused requests"
        )

    def _look(self) -> None:
        """Look after children and evaluators during a wait."""
        if self._control.stop_requested.is_set():
            raise StoppedError
        self._team.tick()
        self._pool.tick()

    def _heard(self, msg: NodeStatus) -> None:
        self._team.heard(msg)
        self._pool.heard(msg)
        self._progress.msg.evaluators = len(self._pool)
        if self._progress.msg.state == "starting":
            self._progress.starting(*self._team.roster.up)
        self._waiter.wake()

    def _wait_for_evaluators(self, others: Callable[[], bool] = lambda: True) -> None:
        """Wait for as many evaluators as work needs, and for something else."""
        wanted = self._options.min_evaluators

        def enough() -> bool:
            return len(self._pool) >= wanted and others()

        if not self._waiter.until(enough, PATIENCE) and len(self._pool) < wanted:
            local = f"; {LOCAL_NOTE}" if is_local() else ""
            self._progress.say(
                f"waiting for evaluators: {len(self._pool)} of {wanted} are here{local}"
            )
        self._waiter.until(enough)

    def _wait_while_paused(self) -> None:
        if self._control.paused.is_set():
            self._progress.enter("paused")
            self._progress.say("paused; call the resume service to continue")
            self._waiter.until(lambda: not self._control.paused.is_set())

    def _report(self, metrics: Metrics) -> None:
        msg = self._progress.msg
        msg.restarts = self._team.children.restarts
        msg.reevaluations = self._critics.reevaluations
        self._progress.generation(metrics)

    def _metrics(self) -> Metrics:
        return call(self._waiter, self._info, GetInfo.Request()).metrics
