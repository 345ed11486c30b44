"""A robot of the demonstration: requests gaits, runs them in simulation, and compares the result with the promise.

Start it next to a run or an archive manager: ``python -m pga_me_ros.demo.robot``
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

import numpy as np
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from pga_me_ros.client import (
    Behavior,
    BehaviorNotFoundError,
    ListedBehavior,
    RepertoireClient,
    RepertoireInfo,
)
from pga_me_ros.client.patient_caller import PatientCaller
from pga_me_ros.client.repertoire_client import TIMEOUT
from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.known_behavior import KnownBehavior
from pga_me_ros.core.storage.shipped import REPERTOIRE, ZOO, shipped
from pga_me_ros.process.early_signals import hand_over
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.process import report
from pga_me_ros.ros.spinning import EndingNode
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import Episode, rollout
from pga_me_ros.yaml_files import parameter_word

OTHER_STARTS = 5
"""Episodes from initial poses that the run has not seen."""

FIT = 0.25
"""Share of the fittest's fitness that another gait may lack to be one to go on with."""

SELDOM = 0.05
"""Share of falls up to which a behavior counts as one that keeps its promise."""

CONVINCING = 0.6
"""Share of the fitness of the shipped best that a run's own must have: a standing hopper has 0.46, a walker 0.54."""

PATIENCE = 60.0
"""Seconds in which a repertoire that is started beside a run must answer, on a slow machine, too."""


def show(behavior: Behavior, info: RepertoireInfo, task: Task) -> bool:
    """Run a behavior and print what it achieved next to what was promised.

    Args:
        behavior: The behavior.
        info: Its repertoire.
        task: Simulation of its task.

    Returns:
        Whether the evaluation repeated with its seed gave the promised fitness and descriptor, bit for bit.
    """
    settings, k = Settings.from_stored(info.settings), behavior.evaluation
    again = rollout(
        task, as_evaluated(settings, behavior.controller, k), evaluation_rng(settings.seed, k)
    )
    equal = again.fitness == behavior.fitness and np.array_equal(
        again.descriptor, behavior.descriptor
    )
    print(_row("promised", behavior.fitness, behavior.descriptor))
    print(
        _row("achieved, same start", again.fitness, again.descriptor)
        + ("   equal" if equal else "   DIFFERENT")
    )
    if behavior.by_mean:
        average = _row(
            f"mean of {behavior.repeats} re-evaluations",
            behavior.mean_fitness,
            behavior.mean_descriptor,
        )
        print(f"{average}   {100.0 * behavior.fall_share:.0f} % fall")
    print(_other_starts(behavior, info, task)[0])
    return equal


def ask_and_run(client: RepertoireClient, node: Node) -> int:
    """Request behaviors, run them and print the results; the last one keeps its promise.

    Args:
        client: Client of the repertoire that was grown.
        node: Node to ask another repertoire through.

    Returns:
        Exit code: 1 if a behavior did not achieve what was promised.
    """
    info = client.get_info()
    task = make_task(info.settings["task"], info.settings.get("randomization", ""))
    try:
        print(
            f"robot (process {os.getpid()}): the repertoire holds {info.coverage} behaviors of {info.task}, "
            f"described by {', '.join(info.descriptor_names)}"
        )
        print("the fittest of them:")
        equal = show(client.get_behavior(best=True), info, task)
        wanted = _first_foot_spared(info)
        behavior = client.get_behavior(descriptor=wanted)
        print(
            f"the one nearest to descriptor {np.round(wanted, 2).tolist()}, {behavior.distance:.3f} away:"
        )
        equal &= show(behavior, info, task)
        name, steady = show_a_steady_one(client, node, info, task)
    finally:
        task.close()
    _print_next(name or served_from(node), unlike_the_fittest(steady, info))
    return 0 if equal else 1


def served_from(node: Node) -> str:
    """Return the folder of the run, or the name of the repertoire, that the archive manager serves.

    It was told so by a command line, a file or a default; it alone knows which of them counted.

    Raises:
        RepertoireTimeoutError: It does not answer.
    """
    caller, name = PatientCaller(node), "archive_manager/get_parameters"
    client = node.create_client(GetParameters, name, callback_group=caller.group)
    request = GetParameters.Request(names=["repertoire"])
    path = Path(caller.call(client, request, _only_text, TIMEOUT))
    path = path.parent if path.name == REPERTOIRE else path
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def _only_text(response: GetParameters.Response) -> str:
    (value,) = response.values
    return str(value.string_value)


def unlike_the_fittest(
    behaviors: Sequence[ListedBehavior], info: RepertoireInfo
) -> np.ndarray | None:
    """Return the descriptor that is farthest from that of the fittest, in shares of each range.

    Those that are much less fit are left out: they may stand still.

    Args:
        behaviors: Behaviors, fittest first.
        info: Their repertoire.

    Returns:
        (d,) float64, None if there is no behavior.
    """
    if not behaviors:
        return None
    enough = FIT * abs(behaviors[0].promised_fitness)
    fit = [b for b in behaviors if behaviors[0].promised_fitness - b.promised_fitness <= enough]
    places = np.array([behavior.promised_descriptor for behavior in fit])
    apart = (places - places[0]) / (info.descriptor_high - info.descriptor_low)
    farthest: np.ndarray = places[np.linalg.norm(apart, axis=1).argmax()]
    return farthest


def show_a_steady_one(
    client: RepertoireClient, node: Node, info: RepertoireInfo, task: Task
) -> tuple[str, tuple[ListedBehavior, ...]]:
    """Run the fittest behavior that seldom falls, and one that comes with the package if that doesn't convince.

    A robot that stands still keeps its promise as well, so that a behavior must also be `CONVINCING`.

    Returns:
        Name of the shipped repertoire whose behavior was the last, empty if it was the run's own or there is none; and
        all behaviors of that repertoire that seldom fall, fittest first.
    """
    own = _steady(client)
    if own:
        print(f"the fittest that falls in at most {SELDOM:.0%} of its re-evaluations:")
        _show_promise(own, info, task)
    else:
        print(
            f"none of them falls in at most {SELDOM:.0%} of its re-evaluations: such gaits take longer to grow "
            "(docs/results.md says how long)."
        )
    if info.task not in shipped():
        return "", _all_steady(client)
    name = f"{ZOO}/{info.task}"
    ready = RepertoireClient(node, repertoire=name, timeout=PATIENCE)
    try:
        steady, ready_info = _steady(ready), ready.get_info()
        if steady is None or convinces(own, steady):
            return "", _all_steady(client)
        if own:
            ratio = steady.promised_fitness / own.promised_fitness
            print(f"a longer run's best is worth {ratio:.1f} times as much:")
        print(f"this one comes with the package: {name}, {ready_info.evaluations:,} evaluations:")
        _show_promise(steady, ready_info, task)
        return name, _all_steady(ready)
    finally:
        ready.close()


def convinces(own: KnownBehavior | None, ready: KnownBehavior) -> bool:
    """Tell whether a behavior of a short run is fit enough to end with.

    Args:
        own: The run's fittest that seldom falls, None if all fall.
        ready: That of the repertoire that comes with the package.
    """
    return own is not None and own.promised_fitness >= CONVINCING * ready.promised_fitness


def _steady(client: RepertoireClient) -> Behavior | None:
    with suppress(BehaviorNotFoundError):
        return client.get_behavior(best=True, max_fall_share=SELDOM)
    return None


def _all_steady(client: RepertoireClient) -> tuple[ListedBehavior, ...]:
    return tuple(client.list_behaviors(max_fall_share=SELDOM))


def _show_promise(behavior: Behavior, info: RepertoireInfo, task: Task) -> None:
    """Run a behavior from starts never seen and print what it achieved next to its mean."""
    words, others = _other_starts(behavior, info, task)
    falls = sum(episode.terminated for episode in others)
    seconds = float(np.median([e.length for e in others])) * behavior.controller.control_period
    print(
        _row("promised", behavior.promised_fitness, behavior.promised_descriptor)
        + f"   mean of {behavior.repeats}"
    )
    print(f"{words}; {falls} fell, {seconds:.1f} s each")


def _print_next(target: str, wanted: np.ndarray | None) -> None:
    """Print commands that ask for another gait that seldom falls, or for the best where there is none."""
    which = "--best"
    if wanted is not None:
        words = " ".join(f"{number:.2f}" for number in wanted)
        which = f"--descriptor {words} --max-fall-share {SELDOM}"
    print("to go on:")
    served = parameter_word("repertoire", target)
    print(f"  ros2 run pga_me_ros archive_manager --ros-args -p {served}")
    print(f"  ros2 run pga_me_ros query {which}")
    print(f"  ros2 run pga_me_ros render {shlex.quote(target)} {which} --seed 1 --out gait.gif")


def _other_starts(
    behavior: Behavior, info: RepertoireInfo, task: Task
) -> tuple[str, list[Episode]]:
    """Run a behavior from starts that its run has not seen; return the median as a row, and the episodes."""
    seed = Settings.from_stored(info.settings).seed + 1
    episodes = [
        rollout(task, behavior.controller, evaluation_rng(seed, k)) for k in range(OTHER_STARTS)
    ]
    fitness = float(np.median([e.fitness for e in episodes]))
    descriptor = np.median([e.descriptor for e in episodes], axis=0)
    return _row(
        f"achieved, {OTHER_STARTS} other starts", fitness, descriptor
    ) + "   median", episodes


def _first_foot_spared(info: RepertoireInfo) -> list[float]:
    share = np.full(len(info.descriptor_low), 0.6)
    share[0] = 0.2
    return (info.descriptor_low + share * (info.descriptor_high - info.descriptor_low)).tolist()


def _row(what: str, fitness: float, descriptor: np.ndarray) -> str:
    entries = " ".join(f"{x:.3f}" for x in descriptor)
    return f"  {what:<26} fitness {fitness:9.2f}   descriptor {entries}"


def main() -> int:
    """Run the robot once."""
    started = False
    node: EndingNode | None = None
    try:
        prepare_environment()
        hand_over()
        rclpy.init()
        started = True
        node = EndingNode("demo_robot", cli_args=["--ros-args", "-r", "__node:=demo_robot"])
        return ask_and_run(RepertoireClient(node), node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        # Ctrl-C ends ROS 2 first; failures after that are a consequence.
        return 0 if started and not rclpy.ok() else report(error)
    finally:
        try:
            if node is not None:
                node.destroy_node()
        finally:
            rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
