"""A robot of the demonstration: requests gaits, runs them in simulation, and compares the result with the promise.

Start it next to a run or an archive manager: ``python -m pga_me_ros.demo.robot [RUN_DIR]``
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from pga_me_ros.client import Behavior, BehaviorNotFoundError, RepertoireClient, RepertoireInfo
from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.runs.run_directory import default_run_dir
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.shipped import ZOO, shipped
from pga_me_ros.process.early_signals import hand_over
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.process import report
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import Episode, rollout

OTHER_STARTS = 5
"""Episodes from initial poses that the run has not seen."""

SELDOM = 0.05
"""Share of falls up to which a behavior counts as one that keeps its promise."""


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


def ask_and_run(client: RepertoireClient, node: Node, run_dir: str) -> int:
    """Request behaviors, run them and print the results; the last one keeps its promise.

    Args:
        client: Client of the repertoire that was grown.
        node: Node to ask another repertoire through.
        run_dir: Folder of the run, empty for the default one.

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
        name = show_a_steady_one(client, node, info, task)
    finally:
        task.close()
    _print_next(name or run_dir or default_run_dir(Settings.from_stored(info.settings)), wanted)
    return 0 if equal else 1


def show_a_steady_one(
    client: RepertoireClient, node: Node, info: RepertoireInfo, task: Task
) -> str:
    """Run a behavior that seldom falls: one of the run's own, else one of the repertoire that comes with the package.

    Returns:
        Name of the shipped repertoire that has it, empty if the run's own has one or there is none.
    """
    own = _steady(client)
    if own:
        print(f"the fittest that falls in at most {SELDOM:.0%} of its re-evaluations:")
        _show_promise(own, info, task)
        return ""
    print(
        f"none of them falls in at most {SELDOM:.0%} of its re-evaluations: such gaits take longer to grow "
        "(docs/results.md says how long)."
    )
    name = f"{ZOO}/{info.task}"
    if info.task not in shipped():
        return ""
    ready = RepertoireClient(node, repertoire=name)
    try:
        steady, ready_info = _steady(ready), ready.get_info()
        if steady:
            print(
                f"this one comes with the package: {name}, {ready_info.evaluations:,} evaluations:"
            )
            _show_promise(steady, ready_info, task)
    finally:
        ready.close()
    return name


def _steady(client: RepertoireClient) -> Behavior | None:
    with suppress(BehaviorNotFoundError):
        return client.get_behavior(best=True, max_fall_share=SELDOM)
    return None


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


def _print_next(target: str | Path, wanted: list[float]) -> None:
    words = " ".join(f"{number:.2f}" for number in wanted)
    print("to go on:")
    print(f"  ros2 run pga_me_ros archive_manager --ros-args -p repertoire:={target}")
    print(f"  ros2 run pga_me_ros query --descriptor {words}")
    print(f"  ros2 run pga_me_ros render {target} --best --seed 1 --out gait.gif")


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
    try:
        prepare_environment()
        hand_over()
        rclpy.init()
        started = True
        node = rclpy.create_node("demo_robot", cli_args=["--ros-args", "-r", "__node:=demo_robot"])
        return ask_and_run(RepertoireClient(node), node, sys.argv[1] if sys.argv[1:] else "")
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        # Ctrl-C ends ROS 2 first; failures after that are a consequence.
        return 0 if started and not rclpy.ok() else report(error)
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
