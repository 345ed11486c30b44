"""Arguments of the client and of a stored run that make no sense are refused before anything is sent."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pga_me_ros import StoredRun
from pga_me_ros.arguments import numbers, whole_number
from pga_me_ros.client.requests import behavior_request, behaviors_request, in_namespace
from pga_me_ros.errors import ArchiveError, RequestError, SettingsError

BAD = [
    ({"cell": 2**70}, "^cell is 1180591620717411303424; give a whole number of at most"),
    ({"cell": 1.5}, "^cell is 1.5; give a whole number"),
    ({"cell": "x"}, "^cell is 'x'; give a whole number"),
    ({"cell": float("inf")}, "^cell is inf; give a whole number"),
    ({"descriptor": 0.5}, r"^descriptor is 0.5; give a list of numbers, .*example \[0.5\]"),
    ({"descriptor": np.float64(0.5)}, "; give a list of numbers"),
    ({"descriptor": np.array(0.5)}, "; give a list of numbers"),
    ({"descriptor": "0.5"}, "^descriptor is '0.5'; give a list of numbers"),
    ({"descriptor": [[0.5]]}, r"^descriptor is or holds \[0.5\]; give a number"),
    ({"descriptor": [None]}, "^descriptor is or holds None; give a number"),
    ({"descriptor": [0.5], "max_distance": "far"}, "^max_distance is or holds 'far'"),
    ({"best": True, "min_fitness": "high"}, "^min_fitness is or holds 'high'"),
]


@pytest.mark.parametrize(("wanted", "words"), BAD)
def test_the_client_refuses_what_makes_no_sense(wanted: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        behavior_request(**wanted)


@pytest.mark.parametrize(("wanted", "words"), BAD)
def test_a_stored_run_refuses_it_too(hopper_run: Path, wanted: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        StoredRun.load(hopper_run).choose(**wanted)


@pytest.mark.parametrize("cell", [-(2**40), 2**63 - 1])
def test_a_cell_that_does_not_exist_is_named(hopper_run: Path, cell: int) -> None:
    with pytest.raises(ArchiveError, match=str(cell)):
        StoredRun.load(hopper_run).choose(cell=cell)


@pytest.mark.parametrize(
    ("prefix", "full"),
    [
        ("", "repertoire/get_info"),
        ("/", "/repertoire/get_info"),
        ("/left", "/left/repertoire/get_info"),
        ("left/", "left/repertoire/get_info"),
        ("~", "~/repertoire/get_info"),
    ],
)
def test_a_namespace_may_be_absolute_or_relative(prefix: str, full: str) -> None:
    assert in_namespace(prefix, "repertoire/get_info") == full


@pytest.mark.parametrize("prefix", ["a b", "/left//leg", "7", "/lä"])
def test_a_namespace_that_ros_does_not_allow_is_refused(prefix: str) -> None:
    with pytest.raises(SettingsError, match=r"^Namespace .*; expected prefix=/"):
        in_namespace(prefix, "repertoire/get_info")


@pytest.mark.parametrize("share", [5, -0.5, math.inf, math.nan, "5 %"])
def test_a_share_of_falls_is_from_0_to_1(hopper_run: Path, share: Any) -> None:
    with pytest.raises(RequestError, match="max_fall_share is"):
        behavior_request(best=True, max_fall_share=share)
    if share != math.inf:  # a stored run takes it for any share
        with pytest.raises(RequestError, match="max_fall_share is"):
            StoredRun.load(hopper_run).choose(best=True, max_fall_share=share)


@pytest.mark.parametrize("number", [1e155, -1e300])
def test_a_descriptor_at_an_immeasurable_distance_is_refused(
    hopper_run: Path, number: float
) -> None:
    with pytest.raises(ArchiveError, match="too far away for a distance; give numbers"):
        StoredRun.load(hopper_run).choose(descriptor=[number])


@pytest.mark.parametrize("count", [2**70, 2.5, "two", None])
def test_a_count_that_is_no_whole_number_is_refused(count: Any) -> None:
    with pytest.raises(RequestError, match=r"^count is .*; give a whole number"):
        behaviors_request([0.5], count)


def test_usual_kinds_of_numbers_are_accepted() -> None:
    assert behavior_request(cell=np.int32(12)).cell == 12
    assert whole_number("cell", 12.0) == 12
    assert numbers("descriptor", np.array([0.5, 1], np.float32)) == [0.5, 1.0]
    assert list(behavior_request(descriptor=(1, 0.25)).descriptor) == [1.0, 0.25]
