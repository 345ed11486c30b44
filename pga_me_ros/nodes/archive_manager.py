"""Archive manager: owns the archive and its file, and answers requests about the repertoire."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pga_me_msgs.msg import Elites, Progress
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import AddToArchive, Extract, SampleParents

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.depth import CellDepth
from pga_me_ros.core.archive.elites import NO_PARENT, Solutions, Status
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.evaluation import evaluation_ids
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.field import setting
from pga_me_ros.core.storage.event_file import EventFile
from pga_me_ros.core.storage.metrics_file import METRICS_FILE, MetricsFile
from pga_me_ros.core.storage.reevaluating import stored_measures
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.rows import Generation
from pga_me_ros.core.storage.stored_run import repertoire_file
from pga_me_ros.errors import RequestError, SettingsError, StorageError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.convert import finite, flat, metrics_to_msg, shaped, with_rates
from pga_me_ros.ros.elites_topic import elites_to_msg
from pga_me_ros.ros.evaluations import evaluated_from_msg, require_minimum
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.namesakes import ELDER, STOP_OR_MOVE, leave_to_elders
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import run_node
from pga_me_ros.serving.archive_pictures import ArchivePictures
from pga_me_ros.serving.repertoire_services import RepertoireServices

STATUS = {status: getattr(AddToArchive.Request, status.name) for status in Status}
"""The message's number for each outcome of a solution."""

LOOK_PERIOD = 1.0
"""Seconds between two looks at whether the elites were re-evaluated."""

GROWING = ("starting", "running", "paused")
"""States of a run in which it adds to the repertoire, or will."""


@dataclass(frozen=True)
class ArchiveManagerSettings:
    """Parameters of the archive manager; everything else is in the repertoire file."""

    repertoire: str = setting(
        "",
        "What to serve: a repertoire file, the folder of a run, or a repertoire that comes with the package, such as "
        "zoo/qd_hopper.",
        path=True,
    )
    grow: bool = setting(
        False, "Whether a run adds to the file; otherwise it is only read, never changed."
    )
    write_events: bool = setting(
        False,
        "Whether to write the metrics of a run as TensorBoard events; only together with grow.",
    )


class ArchiveManager(GraphNode):
    """Serves a repertoire; while a run grows it, also adds generations and draws parents."""

    def __init__(self) -> None:
        super().__init__("archive_manager")
        values = declare(self, ArchiveManagerSettings, shared=(Settings, RunOptions))
        if not values["repertoire"]:
            raise SettingsError(
                "No repertoire is named; give its file: -p repertoire:=RUN_DIR/repertoire.db, or -p "
                "repertoire:=zoo/NAME for one that comes with the package."
            )
        path, self._grow = repertoire_file(values["repertoire"]), values["grow"]
        if values["write_events"] and not self._grow:
            raise SettingsError(
                "write_events is true, but only a run that adds to the repertoire writes events; leave it out."
            )
        self._file = Repertoire.open(path, read_only=not self._grow)
        self._info = self._file.info
        self._settings = Settings.from_stored(self._info.settings)
        generations = self._read_state()
        if self._archive.note:
            self.get_logger().info(self._archive.note)
        self._metrics = generations[-1].metrics if generations else None
        self._table = MetricsFile(path.with_name(METRICS_FILE))
        self._events: EventFile | None = None
        if values["write_events"]:
            self._events = EventFile(path.parent, generations, self.get_logger().warning)
        self._metrics_topic = self.create_publisher(MetricsMsg, names.METRICS, qos.LATCHED)
        dimensions = self._archive.dimensions
        self._pictures = ArchivePictures(self, self._archive)
        self._readers = RepertoireServices(self, self._file, self._archive, self._grow)
        if self._grow:
            self._table.rebuild(generations, stored_measures(path, self._info.run_id, dimensions))
            self._elites_topic = self.create_publisher(Elites, names.ELITES, qos.ELITES)
            self.create_subscription(Progress, names.PROGRESS, self._hear, qos.LATCHED)
            self.serve(AddToArchive, names.ADD_TO_ARCHIVE, self._add)
            self.serve(SampleParents, names.SAMPLE_PARENTS, self._sample)
            self.serve(Extract, names.EXTRACT, self._extract)
        else:  # a run's own is never disturbed
            leave_to_elders(self, lambda msg: msg.kind == "archive_manager", STOP_OR_MOVE)
        self._show()
        # rclpy must not be imported before pga_me_ros.ros has looked at RMW_IMPLEMENTATION.
        from rclpy.clock import Clock, ClockType

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(LOOK_PERIOD, self.unless_ended(self._look), clock=steady)
        if not self._grow:  # it says what it serves once no elder has the name
            words = self._readers.in_words(str(path))
            greet = self.unless_ended(lambda: self._greet(words))
            self._greeting = self.create_timer(ELDER, greet, clock=steady)
        self.start_heartbeat(run_id=self._info.run_id, task=self._info.task["name"])

    @property
    def _last_generation(self) -> int:
        return self._metrics.generation if self._metrics else -1

    def _add(self, request: AddToArchive.Request, response: AddToArchive.Response) -> None:
        self.check_run(request.run_id, self._info.run_id)
        last = self._last_generation
        if not 0 <= request.generation <= last + 1:
            raise RequestError(
                f"Generation {request.generation} cannot be added: the archive has all up to {last}, "
                f"so the next is {last + 1}."
            )
        if request.generation == last + 1:
            response.status = self._commit(self._solutions(request), request)
        response.metrics = self._metrics_msg(self._metrics_of(request.generation))

    def _commit(self, batch: Solutions, request: AddToArchive.Request) -> list[int]:
        rates = with_rates(self._settings, request.rates)
        offered = algorithm_of(self._settings).offered(batch.operators)
        change = None
        if self._depth is None:
            added = self._archive.add(batch, offered)
        else:
            self._require_drawn(batch, request.generation)
            change = self._depth.add(batch, offered)
            added = change.added
        changed = added.changed_cells if change is None else change.changed_cells
        metrics = generation_metrics(self._archive, batch, added, request.generation, self._metrics)
        elites = [self._archive.elite(cell) for cell in changed.tolist()]
        try:
            self._file.commit(request.generation, elites, metrics, rates.rates, change)
        except StorageError:
            self._return_to_file()
            raise
        self._metrics = metrics
        self._publish_elites(changed)
        self.count_done()
        self._show()
        stored = self._file.generation(request.generation)
        self._table.append(stored)
        if self._events:
            self._events.append(stored)
        return [STATUS[status] for status in added.status.tolist()]

    def _read_state(self) -> list[Generation]:
        """Take the archive, and what its cells hold below their elites, from the file; return its generations."""
        generations, self._archive = self._file.load_state()
        self._depth: CellDepth | None = None
        if self._grow and self._settings.extracted:
            self._depth = self._file.load_depth(self._archive, self._settings.cell_depth)
        return generations

    def _drawn(self, generation: int) -> Int64Array:
        """Return which solutions a generation takes out of the archive; it must be the next one."""
        assert self._depth is not None
        s = self._settings
        count = 0 if generation < s.init_generations else s.extracted
        return self._depth.draw(s.seed, generation, count) if count else np.empty(0, np.int64)

    def _require_drawn(self, batch: Solutions, generation: int) -> None:
        """Make sure that a generation evaluated again what it had to.

        Raises:
            RequestError: It did not.
        """
        again = batch.parents[batch.operators == Operator.EXTRACTED, 0]
        drawn = self._drawn(generation)
        if not np.array_equal(again, drawn):
            raise RequestError(
                f"Generation {generation} evaluated solutions {again.tolist()} again; expected {drawn.tolist()}, as "
                f"drawn by {names.EXTRACT}."
            )

    def _extract(self, request: Extract.Request, response: Extract.Response) -> None:
        self.check_run(request.run_id, self._info.run_id)
        if self._depth is None:
            raise RequestError("This run evaluates nothing again: its extract_share is 0.")
        if request.generation != self._last_generation + 1:
            raise RequestError(
                f"Solutions are to be taken out for generation {request.generation}, but the archive has all up to "
                f"{self._last_generation}, so the next is {self._last_generation + 1}."
            )
        drawn = self._drawn(request.generation)
        response.evaluations = flat(drawn, "q")
        if len(drawn):
            response.parameters = flat(self._depth.parameters(drawn), "f")

    def _return_to_file(self) -> None:
        """Forget what could not be committed: what is served is what is stored."""
        self._read_state()
        self._readers.archive = self._archive
        self._pictures.changed(self._archive)

    def _metrics_of(self, generation: int) -> Metrics | None:
        if generation == self._last_generation:
            return self._metrics
        return self._file.generation(generation).metrics

    def _solutions(self, request: AddToArchive.Request) -> Solutions:
        """Read the solutions of a request.

        Raises:
            RequestError: A field has the wrong length, or a number is not finite or out of range.
        """
        b, p = self._settings.batch_size, self._archive.parameter_count
        out = evaluated_from_msg(request, b, self._archive.dimensions)
        parameters = shaped(request.parameters, (b, p), np.float32, "parameters")
        operators = shaped(request.operators, (b,), np.int64, "operators")
        parents = shaped(request.parents, (b, 2), np.int64, "parents")
        require_minimum("steps", out.steps, 1)
        require_minimum("parents", parents, NO_PARENT)
        if operators.max() > max(Operator):
            raise RequestError(
                f"Field 'operators' holds {operators.max()}; expected 0 to {max(Operator):d}."
            )
        return Solutions.of(
            fitness=out.fitness,
            descriptors=out.descriptors,
            parameters=finite(parameters, "parameters"),
            evaluations=evaluation_ids(self._settings, request.generation),
            generation=request.generation,
            operators=operators,
            parents=parents,
            steps=out.steps,
            terminated=out.terminated,
        )

    def _sample(self, request: SampleParents.Request, response: SampleParents.Response) -> None:
        self.check_run(request.run_id, self._info.run_id)
        if request.generation != self._last_generation + 1:
            raise RequestError(
                f"Parents of generation {request.generation} are asked for, but the archive has all "
                f"up to {self._last_generation}, so the next is {self._last_generation + 1}."
            )
        if not 1 <= request.count <= self._settings.batch_size or request.first < 0:
            raise RequestError(
                f"count is {request.count} and first {request.first}; expected 1 to "
                f"{self._settings.batch_size} offspring from place 0 on."
            )
        if request.parents_each not in (1, 2):
            raise RequestError(f"parents_each is {request.parents_each}; expected 1 or 2.")
        cells = algorithm_of(self._settings).choose_parents(
            self._archive,
            self._settings,
            request.generation,
            request.first,
            request.count,
            request.parents_each,
        )
        response.evaluations = flat(self._archive.evaluations[cells], "q")
        if request.publish:
            self._publish_elites(np.unique(cells), again=True)

    def _publish_elites(self, cells: Int64Array, *, again: bool = False) -> None:
        """Publish the elites of some cells, for nodes that make offspring of them."""
        generation = self._last_generation
        self._elites_topic.publish(
            elites_to_msg(self._archive, self._info.run_id, generation, cells, again=again)
        )

    def _hear(self, progress: Progress) -> None:
        """Note whether the run still adds to the repertoire, or has reached its end."""
        if progress.run_id == self._info.run_id:
            self._readers.growing = progress.state in GROWING

    def _greet(self, words: str) -> None:
        """Say once what is served."""
        self._greeting.cancel()
        self.get_logger().info(words)

    def _look(self) -> None:
        """Tell whoever watches when the elites were re-evaluated."""
        if self._readers.outdated:
            self._show()

    def _show(self) -> None:
        """Publish metrics and pictures of the present archive."""
        self._readers.metrics = self._metrics_msg(self._metrics)
        self._metrics_topic.publish(self._readers.metrics)
        self._pictures.changed(self._archive)

    def _metrics_msg(self, metrics: Metrics | None) -> MetricsMsg:
        corrected = self._readers.measures(metrics.generation) if metrics else None
        msg = metrics_to_msg(metrics, self._info, self._archive.cells, corrected)
        msg.stamp = self.get_clock().now().to_msg()
        return msg

    def destroy_node(self) -> None:
        """Close the file, then destroy the node."""
        self._file.close()
        if self._events:
            self._events.close()
        super().destroy_node()


PROGRAM = Program(
    "archive_manager",
    "Serves a repertoire file: /repertoire/get_behavior(s), list_behaviors, list_generations, get_info and get_actor.",
    (ArchiveManagerSettings,),
)


def main() -> int:
    """Run the archive manager."""
    return run_node(PROGRAM, ArchiveManager)


if __name__ == "__main__":
    raise SystemExit(main())
