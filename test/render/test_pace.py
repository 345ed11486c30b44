"""GIFs play as fast as they should, also where pictures follow each other faster than browsers show them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pga_me_ros.render.animation import save_gif

COUNT = 41


def numbered() -> list[Image.Image]:
    """Return pictures that all differ: in each, another column is white."""
    pictures = []
    for k in range(COUNT):
        pixels = np.zeros((8, COUNT, 3), np.uint8)
        pixels[:, k] = 255
        pictures.append(Image.fromarray(pixels))
    return pictures


def shown(path: Path) -> tuple[list[int], list[int]]:
    """Return which pictures a GIF has, and how long each stays, ms."""
    found, lasting = [], []
    with Image.open(path) as image:
        for k in range(image.n_frames):
            image.seek(k)
            found.append(int(np.asarray(image.convert("L"))[0].argmax()))
            lasting.append(image.info["duration"])
    return found, lasting


@pytest.mark.parametrize("pause", [0.001, 0.00825, 0.0165, 0.02])
def test_no_picture_is_shorter_than_browsers_show(pause: float, tmp_path: Path) -> None:
    out = tmp_path / "fast.gif"
    save_gif(out, numbered(), [0.015 + pause * k for k in range(COUNT)])
    found, lasting = shown(out)
    assert min(lasting) >= 20
    assert found[-1] == COUNT - 1
    assert sum(lasting) == pytest.approx(1000 * pause * (COUNT - 1) + 1000, abs=30)
