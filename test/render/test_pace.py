"""GIFs play as fast as they should, also where pictures follow each other faster than browsers show them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pga_me_ros.render.animation import save_gif


def shades_and_times(path: Path) -> tuple[list[int], list[int]]:
    """Return the red of each picture of a GIF, and how long it stays, ms."""
    with Image.open(path) as image:
        shades, lasting = [], []
        for k in range(image.n_frames):
            image.seek(k)
            shades.append(int(np.asarray(image.convert("RGB"))[0, 0, 0]))
            lasting.append(image.info["duration"])
    return shades, lasting


@pytest.mark.parametrize("pause", [0.001, 0.00825, 0.0165, 0.02])
def test_no_picture_is_shorter_than_browsers_show(pause: float, tmp_path: Path) -> None:
    count = 41
    frames = [Image.new("RGB", (4, 4), (6 * k, 0, 0)) for k in range(count)]
    out = tmp_path / "fast.gif"
    save_gif(out, frames, [0.015 + pause * k for k in range(count)])
    shades, lasting = shades_and_times(out)
    assert min(lasting) >= 20
    assert shades[-1] == max(shades), "it ends with the last picture"
    assert sum(lasting) == pytest.approx(1000 * pause * (count - 1) + 1000, abs=30)
