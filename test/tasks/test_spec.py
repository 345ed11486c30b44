"""Task specs: round trip and validation."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import pytest
from broken_tasks import SPEC

from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.registry import BUILT_IN, task_spec
from pga_me_ros.tasks.spec import TaskSpec


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_json_round_trip_gives_the_same_spec(name: str) -> None:
    spec = task_spec(name)
    assert TaskSpec.from_json(json.loads(json.dumps(spec.to_json()))) == spec


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("name", "", "non-empty string"),
        ("observation_names", (), "at least one"),
        ("observation_names", ("x", "x"), "unique"),
        ("observation_names", ["x", "y"], "expected a tuple of str"),
        ("observation_units", ("m",), "1 entries; expected 2"),
        ("action_low", (-1,), "expected a tuple of float"),
        ("action_low", (1.0,), "low < high"),
        ("action_high", (math.inf,), "finite numbers"),
        ("descriptor_high", (math.nan,), "finite numbers"),
        ("descriptor_low", (0.0, 0.0), "2 entries; expected 1"),
        ("max_steps", 0, "at least 1"),
        ("max_steps", True, "expected an int"),
        ("archive_cells", 1.5, "expected an int"),
        ("archive_bins", (0,), "bins >= 1"),
        ("control_period", 0.0, "above 0"),
        ("control_period", 1, "expected a float"),
        ("step_descriptor_names", ("x", "y"), "2 entries; expected 1"),
        ("step_descriptor_names", ("z",), "not an entry of the observation"),
        ("step_descriptor_delay", 2, "expected 0 or 1"),
        ("step_descriptor_delay", True, "expected 0 or 1"),
    ],
)
def test_invalid_field_is_named(field: str, value: Any, message: str) -> None:
    with pytest.raises(TaskError) as caught:
        dataclasses.replace(SPEC, **{field: value})
    assert field in str(caught.value)
    assert message in str(caught.value)


def test_unknown_field_is_refused_with_a_suggestion() -> None:
    with pytest.raises(TaskError, match="did you mean 'max_steps'"):
        TaskSpec.from_json(SPEC.to_json() | {"max_step": 3})


def test_missing_field_is_named() -> None:
    fields = SPEC.to_json()
    del fields["control_period"]
    with pytest.raises(TaskError, match="control_period"):
        TaskSpec.from_json(fields)


def test_a_spec_from_before_state_descriptors_can_still_be_read() -> None:
    fields = SPEC.to_json()
    del fields["step_descriptor_names"], fields["step_descriptor_delay"]
    assert TaskSpec.from_json(fields) == SPEC


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_built_in_tasks_have_a_state_descriptor_entry_per_dimension(name: str) -> None:
    spec = task_spec(name)
    feet = [name.partition("/")[0] for name in spec.descriptor_names]
    assert list(spec.step_descriptor_names) == [f"{foot}/contact" for foot in feet]


def test_anything_but_an_object_is_refused() -> None:
    with pytest.raises(TaskError, match="JSON object"):
        TaskSpec.from_json([1, 2])  # type: ignore[arg-type]
