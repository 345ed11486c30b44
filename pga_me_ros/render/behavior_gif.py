"""Evaluations of behaviors, repeated and drawn as an animated GIF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pga_me_ros.core.settings import Settings
from pga_me_ros.dependencies import require_installed
from pga_me_ros.errors import RequestError
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.recorded_gait import evaluated_again, steps_between
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.rollout import Episode


@dataclass(frozen=True)
class GifOptions:
    """What to show, and how.

    Attributes:
        start: Seconds of the episode to leave out.
        seconds: Maximum seconds of the episode to show.
        speed: 1 for real time.
        fps: Pictures per simulated second.
        size: Width and height, pixels.
        seed: Seed of another initial pose to begin in; None repeats the evaluation that the behavior was found with.
    """

    start: float = 0.0
    seconds: float = 10.0
    speed: float = 1.0
    fps: float = 20.0
    size: tuple[int, int] = (360, 270)
    seed: int | None = None


def require_pillow() -> None:
    """Make sure that pictures can be drawn.

    Raises:
        MissingDependencyError: Pillow is not installed.
    """
    require_installed("PIL")


def draw_gif(task: Task, settings: Settings, gait: Gait, out: Path, options: GifOptions) -> Episode:
    """Run a behavior's evaluation again, or another episode of it, and draw it.

    Args:
        task: The task of its run.
        settings: Settings of its run.
        gait: The behavior.
        out: File to write.
        options: What to show, and how.

    Returns:
        The episode.

    Raises:
        MissingDependencyError: Pillow is not installed.
        RequestError: The episode ends before `options.start`.
        StorageError: The file cannot be written.
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    return draw_gallery(task, settings, [gait], out, options, 1)[0]


def draw_gallery(
    task: Task,
    settings: Settings,
    gaits: Sequence[Gait],
    out: Path,
    options: GifOptions,
    columns: int,
) -> list[Episode]:
    """Draw several behaviors side by side, in step, as one animated GIF; one that has ended keeps its last picture.

    Args:
        task: The task of their run.
        settings: Settings of their run.
        gaits: The behaviors.
        out: File to write.
        options: What to show of each, and how.
        columns: Behaviors per row.

    Returns:
        Their episodes.

    Raises:
        MissingDependencyError: Pillow is not installed.
        RequestError: An episode ends before `options.start`.
        StorageError: The file cannot be written.
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    require_pillow()
    from pga_me_ros.render.animation import animation, save_gif, side_by_side

    period = task.spec.control_period
    episodes, films = [], []
    longest: list[float] = []
    for gait in gaits:
        whole, recording, times = _shown(task, settings, gait, options)
        episodes.append(whole.episode)
        films.append(animation(recording, gait, period, options.size))
        longest = max(longest, times, key=len)
    save_gif(out, side_by_side(films, columns), longest)
    return episodes


def _shown(
    task: Task, settings: Settings, gait: Gait, options: GifOptions
) -> tuple[Recording, Recording, list[float]]:
    """Return a whole episode, the part to show, and the times of its pictures, s."""
    period = task.spec.control_period
    every = steps_between(options.fps, period)
    whole = evaluated_again(task, settings, gait, every, options.seed)
    times = [step * period for step in whole.steps]
    end = options.start + options.seconds
    shown = [k for k, time in enumerate(times) if options.start <= time < end]
    if not shown:
        raise RequestError(f"The episode ends after {times[-1]:.2f} s; give a smaller start.")
    part = slice(shown[0], shown[-1] + 1)
    recording = replace(whole, states=whole.states[part], steps=whole.steps[part])
    return whole, recording, [time / options.speed for time in times[part]]
