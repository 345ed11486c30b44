"""Readers of robots: one per kind of body, each for another simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, get_args

from pga_me_ros.errors import TaskError
from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.model import RobotModel, RobotState
from pga_me_ros.player.mujoco_reader import MujocoReader
from pga_me_ros.tasks.body import AnyBody, Body, MujocoBody


class Reader(Protocol):
    """Reads one robot without changing its simulation."""

    @property
    def body(self) -> AnyBody:
        """The robot in its simulation."""
        ...

    @property
    def model(self) -> RobotModel:
        """Its links and joints."""
        ...

    def state(self) -> RobotState:
        """Return where the robot is now."""
        ...


READERS: Mapping[type, Callable[[Any], Reader]] = {Body: BodyReader, MujocoBody: MujocoReader}
"""By the kind of a task's `body`."""


def reader_of(task: Any) -> Reader:
    """Return a reader of a task's robot.

    Raises:
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    body = body_of(task)
    return READERS[type(body)](body)


def body_of(task: Any) -> AnyBody:
    """Return the robot of a task.

    Raises:
        TaskError: The task has no `body`.
    """
    body = getattr(task, "body", None)
    if not isinstance(body, AnyBody):
        kinds = " or ".join(kind.__name__ for kind in get_args(AnyBody))
        raise TaskError(
            f"task '{task.spec.name}' cannot be shown: it has no property 'body' that is a {kinds} of "
            "pga_me_ros.tasks.body; see docs/tasks.md for how to add one"
        )
    return body
