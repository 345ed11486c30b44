"""The Foxglove layout shows topics and fields that exist in the graph."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from pga_me_msgs.msg import Metrics, Progress
from sensor_msgs.msg import Image
from std_msgs.msg import String

from pga_me_ros.player.model import BASE_LINK, WORLD
from pga_me_ros.ros import names

LAYOUT = json.loads(
    (Path(__file__).resolve().parents[1] / "config" / "foxglove_layout.json").read_text()
)

TYPES = {
    names.METRICS: Metrics,
    names.HEATMAP: Image,
    names.GRID: OccupancyGrid,
    names.PROGRESS: Progress,
    names.ODOMETRY: Odometry,
    names.ROBOT_DESCRIPTION: String,
    names.DIAGNOSTICS: DiagnosticArray,
}
TOPICS = {f"/{name.removeprefix('/')}": kind for name, kind in TYPES.items()}


def strings(part: Any) -> Iterator[str]:
    """Yield all keys and values that are strings."""
    if isinstance(part, str):
        yield part
    elif isinstance(part, dict):
        for key, value in part.items():
            yield from strings(key)
            yield from strings(value)
    elif isinstance(part, list):
        for entry in part:
            yield from strings(entry)


def fields(key: str, part: Any = LAYOUT) -> list[Any]:
    """Return all values of a key, anywhere in the layout."""
    if isinstance(part, list):
        return [value for entry in part for value in fields(key, entry)]
    if not isinstance(part, dict):
        return []
    own = [part[key]] if key in part else []
    return own + [value for entry in part.values() for value in fields(key, entry)]


PATHS = sorted({text for text in strings(LAYOUT) if text.startswith("/")})


@pytest.mark.parametrize("path", PATHS)
def test_every_topic_and_field_exists(path: str) -> None:
    topic, *parts = path.split(".")
    kind = TOPICS[topic]
    for part in parts:
        assert part in kind.get_fields_and_field_types()


def test_it_shows_the_topics_of_a_run_and_a_player() -> None:
    shown = {path.partition(".")[0] for path in PATHS}
    assert shown >= {"/repertoire/heatmap", "/repertoire/metrics", "/robot_description"}
    assert shown >= {"/diagnostics", "/progress"}
    plotted = {path.partition(".")[2] for path in PATHS}
    assert plotted >= {"coverage", "qd_score", "max_fitness"}


def test_every_topic_has_its_full_name() -> None:
    keys = ("imageTopic", "topic", "topicPath", "topicToRender", "value")
    given = [value for key in keys for value in fields(key)]
    assert len(given) == 8
    assert set(given) <= set(PATHS)


def test_the_robot_is_shown_in_the_players_frames() -> None:
    (panel,) = [v for k, v in LAYOUT["configById"].items() if k.startswith("3D!")]
    assert (panel["followTf"], panel["fixedFrame"]) == (BASE_LINK, WORLD)
    assert set(fields("frameId")) == {WORLD}


def test_every_panel_has_its_place_and_its_settings() -> None:
    placed = [text for text in strings(LAYOUT["layout"]) if "!" in text]
    assert sorted(placed) == sorted(LAYOUT["configById"])
