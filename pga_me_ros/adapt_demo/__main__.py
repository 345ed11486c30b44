"""``ros2 run pga_me_ros adapt_demo``: a robot is damaged, tries a few gaits of its repertoire, and walks again."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

import rclpy
from pga_me_msgs.srv import GetInfo
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.adapt_demo.companions import Companions
from pga_me_ros.adapt_demo.picture import draw
from pga_me_ros.adapt_demo.plan import Plan
from pga_me_ros.adapt_demo.robot import POSES, Achieved, Robot
from pga_me_ros.adapt_demo.story import (
    TRIAL_HEADS,
    Found,
    compare,
    ending,
    found_row,
    make_trials,
)
from pga_me_ros.client import Adapter
from pga_me_ros.errors import PgaError
from pga_me_ros.process.program import run_program
from pga_me_ros.process.streams import tell
from pga_me_ros.ros import names
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.spinning import EndingNode

PROGRAM = Program("adapt_demo", "A robot that adapts.", ())


def main(args: Sequence[str] | None = None) -> int:
    """Show it, as the command line says.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as for `run_program`.
    """
    return run_program(lambda: demonstrate(Plan.read(args)))


def demonstrate(plan: Plan) -> None:
    """Show the whole story.

    Raises:
        PgaError: A node does not start or ends, or the picture cannot be written.
    """
    run, budget = plan.run, plan.settings.budget
    with adapter_of(plan) as (adapter, companions):
        sound, damaged = before_and_after(plan)
        task = plan.task(plan.damage)
        try:
            robot = Robot(task)
            companions.wait()
            _say(f"\ntrials, at most {budget}:\n{TRIAL_HEADS}")
            trials = make_trials(adapter, robot, budget, plan.repeat, _say)
            _say(ending(trials))
            found = compare(run, robot, trials, damaged, plan.repeat)
        except PgaError:
            companions.require_alive()  # if one has ended, that is the reason
            raise
        finally:
            task.close()
    _say(f"\nwhat the damaged robot achieves then, mean of {POSES} starts:")
    for way in found:
        _say(found_row(way))
    title, descriptor = f"{plan.name}, damaged: {plan.damage}", run.spec.descriptor_names
    draw(trials.steps, trials.after, found, sound, title, descriptor, plan.out)
    _say(f"\npicture: {plan.out}\nthe gait in motion: {plan.watch(trials.best.cell)}")


def before_and_after(plan: Plan) -> tuple[Achieved, Achieved]:
    """Run the gait with the best promise on the sound and on the damaged robot, and tell what came of it."""
    run, gait = plan.run, plan.run.choose()
    _say(
        f"{plan.name}: {len(run.archive)} gaits of {run.spec.name}; the best one promises {gait.promised_fitness:.0f}"
    )
    if plan.worlds:
        _say(
            f"evaluated in {len(plan.worlds.fitness)} other worlds, any of which the robot may be in"
        )
    averages = []
    for name, damage in (("sound", ""), (f"damaged: {plan.damage}", plan.damage)):
        task = plan.task(damage)
        try:
            averages.append(Robot(task).average(gait.controller))
        finally:
            task.close()
        _say(found_row(Found(name, averages[-1])))
    return averages[0], averages[1]


@contextmanager
def adapter_of(plan: Plan) -> Iterator[tuple[Adapter, Companions]]:
    """Start a graph with the repertoire and an adapter, in a namespace of its own, and provide a client.

    Yields:
        The client, and the nodes, which may still be starting.
    """
    namespace = f"/adapt_demo_{uuid.uuid4().hex}"
    remap = ["--ros-args", "-r", f"__ns:={namespace}"]
    start(PROGRAM, remap, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with tempfile.TemporaryDirectory(prefix="adapt_demo-") as folder:
            node = EndingNode("robot")
            adapter, info = Adapter(node), node.create_client(GetInfo, names.GET_INFO)
            companions = Companions(Path(folder), namespace, (info, *adapter.clients))
            try:
                repertoire = str(plan.run.file.resolve())
                companions.start("archive_manager", {"repertoire": repertoire})
                settings = {"memory": f"{folder}/memory.db", **dataclasses.asdict(plan.settings)}
                if plan.worlds:
                    settings["worlds"] = repertoire
                companions.start("adapter", settings)
                yield adapter, companions
            finally:
                companions.close()
                node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _say(text: str) -> None:
    tell(text, reader_counts=True)


if __name__ == "__main__":
    raise SystemExit(main())
