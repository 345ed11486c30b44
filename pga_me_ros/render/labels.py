"""Text in pictures."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pga_me_ros.player.gait import Gait
from pga_me_ros.render.scene import Picture

INK = (40, 44, 52)
PAPER = (255, 255, 255)
LETTERS = 13
"""Font size, pixels."""

LEFT = 6
"""Space between the left edge of a picture and its words, pixels."""

LINE = 1.35
"""Distance between lines of text, relative to the font size."""


def described(gait: Gait) -> list[str]:
    """Return what a gait promises, in two lines, and a third one where it is what it did on average."""
    numbers = ", ".join(f"{x:.2f}" for x in gait.promised_descriptor)
    lines = [f"[{numbers}]", f"fitness {gait.promised_fitness:.0f}"]
    if gait.by_mean:
        lines.append(f"mean of {gait.repeats}, {100.0 * gait.fall_share:.0f} % fall")
    return lines


def write(image: Image.Image, place: tuple[float, float], lines: list[str], size: int) -> None:
    """Write lines of text into an image.

    Args:
        image: Image to change.
        place: Upper left corner, pixels.
        lines: Text.
        size: Font size, pixels.
    """
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size)
    for k, line in enumerate(lines):
        draw.text((place[0], place[1] + k * LINE * size), line, fill=INK, font=font)


def wrapped(words: list[str], width: float, size: int) -> list[str]:
    """Return words joined by commas, in as few lines as fit; one that is wider than a line has a line of its own.

    Args:
        words: What to say.
        width: Width of a line, pixels.
        size: Font size, pixels.
    """
    font, lines = ImageFont.load_default(size), words[:1]
    for word in words[1:]:
        longer = f"{lines[-1]}, {word}"
        if font.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def labelled(picture: Picture, lines: list[str], size: int = LETTERS) -> Image.Image:
    """Return a picture with lines of text in its upper left corner.

    Args:
        picture: (height, width, 3) uint8.
        lines: Text.
        size: Font size, pixels.
    """
    image = Image.fromarray(np.ascontiguousarray(picture))
    write(image, (LEFT, 4), lines, size)
    return image
