"""Many gaits of an archive in one picture: one row per gait, moments of the episode from left to right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from pga_me_ros.errors import RequestError
from pga_me_ros.player.camera import Camera
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.render.labels import LETTERS, PAPER, described, write
from pga_me_ros.render.open_scene import AnyScene, open_scene

LABEL = 150
"""Width of the column of text, pixels."""

HEAD = 34
"""Height of the title, pixels."""

GAP = 3
"""Space between two pictures, pixels."""


SIZE = (176, 132)
"""Width and height of a picture, pixels."""

ROOM = 200_000_000
"""Most pixels of a sheet."""


@dataclass(frozen=True)
class Row:
    """A gait and an episode of it."""

    gait: Gait
    recording: Recording


def sheet_size(rows: int, columns: int) -> tuple[int, int]:
    """Return the width and height of a sheet, pixels.

    Args:
        rows: Number of gaits.
        columns: Moments per gait.

    Raises:
        RequestError: It is too large to be drawn.
    """
    width, height = LABEL + columns * (SIZE[0] + GAP), HEAD + rows * (SIZE[1] + GAP)
    if width * height > ROOM:
        raise RequestError(
            f"A sheet of {rows} gaits at {columns} moments would have {width} x {height} pixels; at most "
            f"{ROOM / 1e6:.0f} million are drawn: give a smaller --sheet or fewer --columns."
        )
    return width, height


def contact_sheet(
    title: str,
    rows: Sequence[Row],
    columns: int,
    period: float,
) -> Image.Image:
    """Draw a contact sheet.

    Args:
        title: Heading.
        rows: What to show, all of the same robot.
        columns: Moments per gait, evenly spaced over its episode.
        period: Time of a step, s.
    """
    width, height = SIZE
    sheet = Image.new("RGB", sheet_size(len(rows), columns), PAPER)
    write(sheet, (8, 8), [title], LETTERS + 2)
    scene = open_scene(rows[0].recording, *SIZE)
    try:
        for i, row in enumerate(rows):
            top = HEAD + i * (height + GAP)
            write(sheet, (8, top + 8), _words(row, period), LETTERS)
            for j, picture in enumerate(_moments(row.recording, columns, scene, period)):
                sheet.paste(picture, (LABEL + j * (width + GAP), top))
    finally:
        scene.close()
    return sheet


def _moments(
    recording: Recording, columns: int, scene: AnyScene, period: float
) -> list[Image.Image]:
    camera = Camera.for_robot(recording.model, recording.states[0])
    start = recording.states[0].base.position[0]
    pictures = []
    for k in np.linspace(0, len(recording.states) - 1, columns).round().astype(int):
        state, step = recording.states[k], recording.steps[k]
        image = Image.fromarray(scene.picture(state, camera))
        words = f"{step * period:.2f} s   {state.base.position[0] - start:+.2f} m"
        write(image, (5, 3), [words], LETTERS - 2)
        pictures.append(image)
    return pictures


def _words(row: Row, period: float) -> list[str]:
    episode = row.recording.episode
    seconds = episode.length * period
    end = f"falls after {seconds:.1f} s" if episode.terminated else f"lasts {seconds:.1f} s"
    return [f"cell {row.gait.cell}", *described(row.gait), end]
