"""Missing episodes of a recording."""

from __future__ import annotations

import pytest

from pga_me_ros.recording.gaps import SeenEpisodes, ranges


def seen(*ids: int, committed: int | None = None) -> SeenEpisodes:
    episodes = SeenEpisodes()
    for k in ids:
        episodes.add(k)
    episodes.committed = committed
    return episodes


@pytest.mark.parametrize(
    ("episodes", "missing"),
    [
        (seen(), []),
        (seen(committed=10), []),
        (seen(3, 0, 1), [2]),
        (seen(0, 1, 3, committed=2), []),
        (seen(0, 1, 3, committed=0), []),
        (seen(0, 1, committed=4), [2, 3]),
        (seen(12, 14, 15, committed=16), [13]),
    ],
)
def test_only_episodes_of_finished_generations_can_be_missing(episodes, missing) -> None:
    assert episodes.missing() == missing


def test_repeated_episodes_are_counted() -> None:
    assert seen(4, 5, 4, 4).repeated == 2


def test_ids_are_shown_as_ranges() -> None:
    assert ranges([3, 7, 8, 9, 11]) == "3, 7-9, 11"
    assert ranges(range(0, 40, 2)) == "0, 2, 4, 6, 8, 10, 12, 14 and 12 more ranges"
