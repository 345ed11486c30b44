"""Pictures that would fill the memory are refused before they are drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.errors import RequestError
from pga_me_ros.library import StoredRun
from pga_me_ros.render.animation import require_room
from pga_me_ros.render.contact_sheet import GAP, LABEL, sheet_size


@pytest.mark.parametrize(
    ("pictures", "seconds", "size", "count", "columns", "message"),
    [
        (200, 10.0, (4096, 4096), 1, 1, "pixels, 3,355 million in all; at most 500 million"),
        (200, 10.0, (360, 270), 100, 3, "200 pictures of 1084 x 9246 pixels, 2,005 million"),
        (1, 0.0, (4096, 1), 100, 100, "1 pictures of 409798 x 1 pixels"),
        (
            3,
            1400.0,
            (360, 270),
            1,
            1,
            "A picture would stay for 700 s, but in a GIF for at most 655",
        ),
    ],
)
def test_a_gif_that_has_no_room_is_refused_before_it_is_drawn(
    pictures: int,
    seconds: float,
    size: tuple[int, int],
    count: int,
    columns: int,
    message: str,
) -> None:
    times = np.linspace(0.0, seconds, pictures).tolist()
    with pytest.raises(RequestError, match=message):
        require_room(times, size, count, columns)


def test_a_sheet_that_has_no_room_is_refused() -> None:
    assert sheet_size(40, 100)[0] == LABEL + 100 * (176 + GAP)
    with pytest.raises(RequestError, match="at most 200 million are drawn: give a smaller --sheet"):
        sheet_size(100, 100)


def test_the_library_draws_no_picture_that_is_too_large(tmp_path: Path) -> None:
    stored = StoredRun.load("zoo/qd_hopper")
    with pytest.raises(RequestError, match="size is 70000 x 70000"):
        stored.save_gif(stored.choose(), tmp_path / "gait.gif", size=(70000, 70000))
