"""What is randomized, as text: read, or refused with what was wrong."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.randomization import KINDS, RandomizationError, canonical, read_ranges
from pga_me_ros.tasks.registry import make_task, randomization_option
from pga_me_ros.tasks.spec import TaskSpec


def test_kinds_come_in_their_own_order_whatever_that_of_the_text() -> None:
    ranges = read_ranges("push 0 100, mass 0.8 1.2,friction  0.5 1.0")
    assert list(ranges.items()) == [
        ("mass", (0.8, 1.2)),
        ("friction", (0.5, 1.0)),
        ("push", (0.0, 100.0)),
    ]


def test_one_number_is_always_the_same() -> None:
    assert read_ranges("delay 2") == {"delay": (2.0, 2.0)}


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("friction 0.30  6e-1", "friction 0.3 0.6"),
        ("push 0 100,mass 0.8 1.2", "mass 0.8 1.2, push 0 100"),
        ("delay 2.0 2", "delay 2"),
        ("noise -0.0 0.00001", "noise 0 1e-05"),
        (" ", ""),
    ],
)
def test_texts_with_the_same_ranges_have_one_text(text: str, same: str) -> None:
    assert canonical(text) == canonical(same) == same
    assert read_ranges(text) == read_ranges(same)


@pytest.mark.parametrize("text", ["", "   "])
def test_nothing_is_nothing(text: str) -> None:
    assert read_ranges(text) == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass 1.2 0.8", r"mass 1\.2 to 0\.8; give the smaller number first"),
        ("masses 1 2", r"'masses 1 2' \(did you mean 'mass'\?\); give KIND LOW HIGH"),
        ("gravity 1 2", "KIND is one of mass, friction, torque, delay, noise, push"),
        ("mass 1 2, mass 1 2", "mass twice"),
        ("mass", "gives mass ''; give two numbers"),
        ("mass 1 2 3", "gives mass '1 2 3'; give two numbers"),
        ("mass heavy", "gives mass 'heavy'; give two numbers"),
        ("mass nan", "gives mass 'nan'; give two numbers"),
        ("mass 0 1", r"mass 0 to 1; expected numbers from 0\.05 to 20"),
        ("noise -1 1", "noise -1 to 1; expected numbers from 0 to 5"),
        ("delay 0 1.5", r"delay 0 to 1\.5; give whole numbers"),
        ("mass 1 2,", r"has ''; give KIND LOW HIGH"),
    ],
)
def test_what_makes_no_sense_is_refused(text: str, words: str) -> None:
    with pytest.raises(RandomizationError, match=words):
        read_ranges(text)
    assert issubclass(RandomizationError, TaskError)


def test_every_kind_says_what_it_is() -> None:
    assert all(kind.meaning and kind.low < kind.high for kind in KINDS.values())


class Plain:
    """A task without the argument."""

    spec: ClassVar[Any] = None


class Able(Plain):
    """A task with it."""

    def __init__(self, *, randomization: str = "") -> None:
        self.randomization = randomization


def test_a_task_that_cannot_be_randomized_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = TaskSpec(
        "t", ("o",), ("",), ("a",), ("",), (-1.0,), (1.0,), ("d",), (0.0,), (1.0,), 1, 1.0, 1, (1,)
    )
    monkeypatch.setattr(Plain, "spec", spec)
    with pytest.raises(RandomizationError, match=r"takes no argument `randomization`"):
        make_task(f"{__name__}:Plain", "mass 1 2")
    assert isinstance(make_task(f"{__name__}:Plain", ""), Plain)
    able = make_task(f"{__name__}:Able", "mass 1 2")
    assert isinstance(able, Able)
    assert able.randomization == "mass 1 2"
    assert randomization_option("qd_hopper", "mass 1 2") == {"randomization": "mass 1 2"}
