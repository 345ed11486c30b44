"""The service get_actor: one network for all behaviors, in a message that any language can run (DCRL-MAP-Elites)."""

from __future__ import annotations

from pathlib import Path

from pga_me_msgs.msg import Controller as ControllerMsg
from pga_me_msgs.srv import GetActor

from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.runs.critic_checkpoints import STEM
from pga_me_ros.core.runs.stored_actor import NoActorError, StoredActor
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.actor_file import FILE
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import controller_to_msg, flat
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.tasks.spec import TaskSpec

UNLIMITED = 1e308
"""Limit of an observation entry that has none, or none that is known; JSON has no infinity."""

WANTED = "wanted/"
"""Begins the names of the entries that are the wanted descriptor."""


class ActorService:
    """Answers with the actor that was trained last; its files are read again when they change.

    Args:
        node: Node that offers the service.
        info: Description of the run in the repertoire file.
        spec: Its task.
        path: The repertoire file; the actor is in a file next to it.
    """

    def __init__(self, node: GraphNode, info: RunInfo, spec: TaskSpec, path: Path) -> None:
        self._node = node
        self._info = info
        self._spec = spec
        self._path = path
        self._files: list[tuple[str, int, int]] = []
        self._answer: tuple[int, ControllerMsg] | None = None
        node.serve(GetActor, names.GET_ACTOR, self._get_actor, "found", qos.ASKED_BY_MANY)

    def _get_actor(self, _: GetActor.Request, response: GetActor.Response) -> None:
        files = self._look()
        if self._answer is None or files != self._files:
            settings = Settings.from_stored(self._info.settings)
            try:
                stored = StoredActor.load(self._path, self._info.run_id, self._spec, settings)
            except NoActorError as reason:  # a regular answer, not an error of the caller
                response.found, response.message = False, str(reason)
                return
            if stored.note:
                self._node.get_logger().warning(stored.note)
            self._answer = stored.generation, actor_to_msg(stored.actor, self._spec)
            self._files = files
        response.generation, response.controller = self._answer
        self._node.count_done()

    def _look(self) -> list[tuple[str, int, int]]:
        """Return a signature of the files that may hold the actor, which changes whenever one is replaced."""
        found = []
        for pattern in (f"{STEM}-*.ckpt", FILE):
            for file in sorted(self._path.parent.glob(pattern)):
                try:
                    now = file.stat()
                except OSError:  # deleted by the run meanwhile
                    continue
                found.append((file.name, now.st_ino, now.st_mtime_ns))
        return found


def actor_to_msg(actor: ConditionedActor, spec: TaskSpec) -> ControllerMsg:
    """Return an actor as a self-contained message, whose network takes descriptors in the task's units."""
    msg = controller_to_msg(actor.in_task_units(), actor.shape, spec)
    msg.observation_names = [
        *spec.observation_names,
        *(f"{WANTED}{n}" for n in spec.descriptor_names),
    ]
    msg.observation_units = [*msg.observation_units, *[""] * spec.descriptor_dim]
    unlimited = [UNLIMITED] * spec.observation_dim
    low = spec.observation_low or [-limit for limit in unlimited]
    msg.observation_low = flat([*low, *spec.descriptor_low], "d")
    msg.observation_high = flat([*(spec.observation_high or unlimited), *spec.descriptor_high], "d")
    return msg
