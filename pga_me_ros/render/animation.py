"""Gaits as an animated GIF."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from pga_me_ros.core.storage.files import save_bytes
from pga_me_ros.errors import RequestError
from pga_me_ros.player.camera import Camera
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.render.labels import LEFT, LETTERS, PAPER, described, labelled, wrapped
from pga_me_ros.render.open_scene import open_scene

COLORS = 64
"""Number of colors of a GIF: few colors make small files, and flat shades need no more."""

GAP = 2
"""Space between two animations side by side, pixels."""

TICK = 0.01
"""Unit of a GIF's times, s."""

SHORTEST = 2
"""Fewest ticks that a picture stays: browsers show one of a single tick, or none, for ten."""

LARGEST = 65_535
"""Most pixels of a side of a GIF, and most units that one of its pictures may stay."""

ROOM = 500_000_000
"""Most pixels of all pictures together; they need about seven bytes each."""


def require_room(times: Sequence[float], size: tuple[int, int], count: int, columns: int) -> None:
    """Make sure that animations side by side fit into memory and into a GIF, before they are drawn.

    Args:
        times: Time of each picture, s from the start.
        size: Width and height of one animation, pixels.
        count: Number of animations.
        columns: Animations per row.

    Raises:
        RequestError: They do not.
    """
    width, height = _whole(size, count, columns)
    pixels = len(times) * width * height
    if max(width, height) > LARGEST or pixels > ROOM:
        raise RequestError(
            f"The GIF would have {len(times)} pictures of {width} x {height} pixels, {pixels / 1e6:,.0f} million in "
            f"all; at most {ROOM / 1e6:.0f} million are drawn, and {LARGEST} along a side. Give a smaller size, fewer "
            "gaits, fewer seconds or a lower fps."
        )
    longest = max((b - a for a, b in itertools.pairwise(times)), default=0.0)
    if longest > LARGEST * TICK:
        raise RequestError(
            f"A picture would stay for {longest:,.0f} s, but in a GIF for at most {LARGEST * TICK:.0f} s; give a "
            "greater speed or fps."
        )


def _whole(size: tuple[int, int], count: int, columns: int) -> tuple[int, int]:
    """Return the width and height of animations side by side, pixels."""
    columns = min(columns, count)
    rows = -(-count // columns)
    return columns * (size[0] + GAP) - GAP, rows * (size[1] + GAP) - GAP


def animation(
    recording: Recording, gait: Gait, period: float, size: tuple[int, int]
) -> list[Image.Image]:
    """Draw the frames of an animation.

    Args:
        recording: The episode.
        gait: Its gait.
        period: Time of a step, s.
        size: Width and height, pixels.
    """
    camera = Camera.for_robot(recording.model, recording.states[0])
    scene = open_scene(recording, *size)
    start = recording.states[0].base.position[0]
    title = wrapped(described(gait), size[0] - 2 * LEFT, LETTERS)
    frames = []
    try:
        for step, state in zip(recording.steps, recording.states, strict=True):
            x = state.base.position[0] - start
            lines = [*title, f"{step * period:.2f} s   {x:+.2f} m"]
            frames.append(labelled(scene.picture(state, camera), lines))
    finally:
        scene.close()
    return frames


def side_by_side(films: Sequence[list[Image.Image]], columns: int) -> list[Image.Image]:
    """Put animations into one, in rows; one that is over keeps its last picture.

    Args:
        films: Frames of each animation, all of the same size.
        columns: Animations per row.
    """
    width, height = films[0][0].size
    columns = min(columns, len(films))
    whole = _whole((width, height), len(films), columns)
    frames = []
    for k in range(max(len(film) for film in films)):
        frame = Image.new("RGB", whole, PAPER)
        for i, film in enumerate(films):
            place = (i % columns * (width + GAP), i // columns * (height + GAP))
            frame.paste(film[min(k, len(film) - 1)], place)
        frames.append(frame)
    return frames


def spaced(ticks: Sequence[int]) -> list[int]:
    """Return the pictures that can be shown, at least `SHORTEST` ticks apart; the last one is always among them.

    Args:
        ticks: Time of each picture, ticks from the start.

    Returns:
        Indices, ascending.
    """
    kept = [len(ticks) - 1]
    for k in reversed(range(len(ticks) - 1)):
        if ticks[kept[-1]] - ticks[k] >= SHORTEST:
            kept.append(k)
    return kept[::-1]


def save_gif(path: Path, frames: list[Image.Image], times: list[float]) -> None:
    """Write an animation that repeats forever.

    Args:
        path: File to write.
        frames: Its pictures. Those that follow too fast for browsers are left out.
        times: Time of each frame, s from the start. The last one stays for a second.

    Raises:
        StorageError: The file cannot be written.
    """
    # Times are rounded, not durations, so that errors do not add up.
    ticks = [round(time / TICK) for time in times]
    kept = spaced(ticks)
    frames, ticks = [frames[k] for k in kept], [ticks[k] for k in kept]
    # One palette for all, or colors would flicker; made from frames throughout, as the first may lack some colors.
    sample = frames[:: max(1, len(frames) // 6)]
    strip = Image.new("RGB", (frames[0].width, frames[0].height * len(sample)))
    for k, frame in enumerate(sample):
        strip.paste(frame, (0, k * frame.height))
    palette = strip.quantize(COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    lasting = [10 * (b - a) for a, b in itertools.pairwise(ticks)] + [1000]
    content = io.BytesIO()
    few[0].save(
        content,
        format="GIF",
        save_all=True,
        append_images=few[1:],
        duration=lasting,
        loop=0,
        optimize=False,
    )
    save_bytes(path, content.getvalue())
