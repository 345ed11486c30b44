"""Archive manager: owns the archive and its file, and answers requests about the repertoire."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pga_me_msgs.msg import Elites
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import AddToArchive, SampleParents

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.elites import NO_PARENT, Solutions, Status
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.evaluation import evaluation_ids
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.field import setting
from pga_me_ros.core.storage.metrics_file import METRICS_FILE, MetricsFile
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import RequestError, SettingsError, StorageError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.convert import (
    evaluated_from_msg,
    finite,
    flat,
    metrics_to_msg,
    shaped,
    with_rates,
)
from pga_me_ros.ros.elites_topic import elites_to_msg
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.namesakes import leave_to_elders
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import run_node
from pga_me_ros.serving.archive_pictures import ArchivePictures
from pga_me_ros.serving.repertoire_services import RepertoireServices

STATUS = {status: getattr(AddToArchive.Request, status.name) for status in Status}
"""The message's number for each outcome of a solution."""

OTHER_NAME = "Stop that node, or give this one a namespace (--ros-args -r __ns:=/NAME) or another ROS_DOMAIN_ID."
"""What the user can do if another archive manager has the name."""


@dataclass(frozen=True)
class ArchiveManagerSettings:
    """Parameters of the archive manager; everything else is in the repertoire file."""

    repertoire: str = setting(
        "", "Repertoire file, for example runs/qd_walker-seed0/repertoire.db.", path=True
    )
    grow: bool = setting(
        False, "Whether a run adds to the file; otherwise it is only read, never changed."
    )


class ArchiveManager(GraphNode):
    """Serves a repertoire; while a run grows it, also adds generations and draws parents."""

    def __init__(self) -> None:
        super().__init__("archive_manager")
        values = declare(self, ArchiveManagerSettings, shared=(Settings, RunOptions))
        if not values["repertoire"]:
            raise SettingsError(
                "No repertoire is named; give its file: -p repertoire:=RUN_DIR/repertoire.db"
            )
        path, self._grow = Path(values["repertoire"]), values["grow"]
        self._file = Repertoire.open(path, read_only=not self._grow)
        self._info = self._file.info
        self._settings = Settings.from_stored(self._info.settings)
        self._archive = self._file.load_archive()
        if self._archive.note:
            self.get_logger().info(self._archive.note)
        generations = self._file.generations()
        self._metrics = generations[-1].metrics if generations else None
        self._table = MetricsFile(path.with_name(METRICS_FILE))
        self._metrics_topic = self.create_publisher(MetricsMsg, names.METRICS, qos.LATCHED)
        self._pictures = ArchivePictures(self, self._archive)
        self._readers = RepertoireServices(self, self._info, self._archive, self._grow, path)
        if self._grow:
            self._table.rebuild(generations)
            self._elites_topic = self.create_publisher(Elites, names.ELITES, qos.ELITES)
            self.serve(AddToArchive, names.ADD_TO_ARCHIVE, self._add)
            self.serve(SampleParents, names.SAMPLE_PARENTS, self._sample)
        else:  # a run's own archive manager is never disturbed
            leave_to_elders(self, lambda msg: msg.kind == "archive_manager", OTHER_NAME)
        self._show()
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
        added = self._archive.add(batch, offered)
        metrics = generation_metrics(self._archive, batch, added, request.generation, self._metrics)
        elites = [self._archive.elite(cell) for cell in added.changed_cells.tolist()]
        try:
            self._file.commit(request.generation, elites, metrics, rates.rates)
        except StorageError:
            self._return_to_file()
            raise
        self._metrics = metrics
        self._publish_elites(added.changed_cells)
        self.count_done()
        self._show()
        self._table.append(self._file.generation(request.generation))
        return [STATUS[status] for status in added.status.tolist()]

    def _return_to_file(self) -> None:
        """Forget what could not be committed, so that only stored content is served."""
        self._archive = self._file.load_archive()
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
        _require_least("steps", out.steps, 1)
        _require_least("parents", parents, NO_PARENT)
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
            self._publish_elites(np.unique(cells))

    def _publish_elites(self, cells: Int64Array) -> None:
        """Publish the elites of some cells, for nodes that make offspring of them."""
        self._elites_topic.publish(
            elites_to_msg(self._archive, self._info.run_id, self._last_generation, cells)
        )

    def _show(self) -> None:
        """Publish metrics and pictures of the present archive."""
        self._readers.metrics = self._metrics_msg(self._metrics)
        self._metrics_topic.publish(self._readers.metrics)
        self._pictures.changed(self._archive)

    def _metrics_msg(self, metrics: Metrics | None) -> MetricsMsg:
        msg = metrics_to_msg(metrics, self._info, self._archive.cells)
        msg.stamp = self.get_clock().now().to_msg()
        return msg

    def destroy_node(self) -> None:
        """Close the file, then destroy the node."""
        self._file.close()
        super().destroy_node()


def _require_least(name: str, values: np.ndarray, least: int) -> None:
    if values.min() < least:
        raise RequestError(f"Field '{name}' holds {values.min()}; expected {least} or more.")


PROGRAM = Program(
    "archive_manager",
    "Serves a repertoire file: /repertoire/get_behavior, get_behaviors, list_behaviors and get_info.",
    (ArchiveManagerSettings,),
)


def main() -> int:
    """Run the archive manager."""
    return run_node(PROGRAM, ArchiveManager)


if __name__ == "__main__":
    raise SystemExit(main())
