"""Evaluations of behaviors, repeated and drawn as an animated GIF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pga_me_ros.arguments import number, whole_number
from pga_me_ros.core.settings import Settings
from pga_me_ros.dependencies import require_installed
from pga_me_ros.errors import RequestError
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.recorded_gait import evaluated_again, steps_between
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.rollout import Episode

LIMITS = {
    "start": (0.0, 1_000_000),
    "seconds": (0.001, 1_000_000),
    "speed": (0.001, 1000),
    "fps": (0.01, 1000),
}
"""Least and greatest values of options."""

MOST_PIXELS = 4096
"""Greatest width and height of one gait's picture."""


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

    Raises:
        RequestError: A number is not within `LIMITS`, or a side of more than `MOST_PIXELS`.
    """

    start: float = 0.0
    seconds: float = 10.0
    speed: float = 1.0
    fps: float = 20.0
    size: tuple[int, int] = (360, 270)
    seed: int | None = None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            RequestError: One is not within its limits.
        """
        for name, (low, high) in LIMITS.items():
            value = number(name, getattr(self, name))
            if not low <= value <= high:
                raise RequestError(f"{name} is {value:g}; give a number from {low:g} to {high:,}.")
        if not all(1 <= whole_number("size", pixels) <= MOST_PIXELS for pixels in self.size):
            width, height = self.size
            raise RequestError(
                f"size is {width} x {height}; give a width and a height of 1 to {MOST_PIXELS} pixels."
            )


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
        RequestError: The episode ends before `options.start`, or the GIF would be too large or too slow.
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
        RequestError: An episode ends before `options.start`, or the GIF would be too large or too slow.
        StorageError: The file cannot be written.
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    require_pillow()
    from pga_me_ros.render.animation import animation, require_room, save_gif, side_by_side

    period = task.spec.control_period
    shown = [_shown(task, settings, gait, options) for gait in gaits]
    times = max((times for _, _, times in shown), key=len)
    require_room(times, options.size, len(gaits), columns)
    films = [
        animation(recording, gait, period, options.size)
        for gait, (_, recording, _) in zip(gaits, shown, strict=True)
    ]
    save_gif(out, side_by_side(films, columns), times)
    return [whole.episode for whole, _, _ in shown]


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
