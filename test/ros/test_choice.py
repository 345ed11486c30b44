"""Which behavior the parameters of player and controller choose."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from pga_me_ros.core.settings.field import checked_value
from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.choice import ChoiceSettings, wanted


def values(**given: Any) -> dict[str, Any]:
    return {**dataclasses.asdict(ChoiceSettings()), **given}


@pytest.mark.parametrize(
    ("given", "choice"),
    [
        ({}, {"best": True}),
        ({"descriptor": (0.9, 0.1)}, {"descriptor": [0.9, 0.1]}),
        ({"cell": 0}, {"cell": 0}),
        ({"select": "random", "min_fitness": 5.0}, {"random": True, "min_fitness": 5.0}),
        (
            {"single": True, "max_fall_share": 0.1},
            {"best": True, "single": True, "max_fall_share": 0.1},
        ),
    ],
)
def test_the_choice_follows_from_what_is_given(
    given: dict[str, Any], choice: dict[str, Any]
) -> None:
    assert wanted(values(**given)) == choice


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"descriptor": (0.9,), "cell": 3}, "descriptor and cell given"),
        ({"select": "best", "cell": 3}, "cell given, but the gait is chosen by best"),
        ({"select": "descriptor"}, "no descriptor is given"),
    ],
)
def test_contradictions_are_reported(given: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        wanted(values(**given))


def test_a_descriptor_is_a_list_of_numbers() -> None:
    (field,) = (f for f in dataclasses.fields(ChoiceSettings) if f.name == "descriptor")
    assert checked_value(field, [1, 0.5]) == (1.0, 0.5)
    assert checked_value(field, []) == ()
    with pytest.raises(SettingsError, match="list of numbers, not 'best'"):
        checked_value(field, "best")
