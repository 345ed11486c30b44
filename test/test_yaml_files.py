"""Words of command lines that a shell reads first, and YAML after it."""

from __future__ import annotations

import shlex

import pytest
import yaml

from pga_me_ros.yaml_files import parameter_word


@pytest.mark.parametrize(
    "text",
    ["zoo/qd_hopper", "runs/a b", "run #2", "gait: é", "12", "on", "'a'", '"', "$HOME", "\\"],
)
def test_a_parameter_arrives_as_it_was_given(text: str) -> None:
    (word,) = shlex.split(parameter_word("repertoire", text))
    name, _, value = word.partition(":=")
    assert (name, yaml.safe_load(value)) == ("repertoire", text)


def test_a_plain_name_has_no_quotes() -> None:
    assert parameter_word("repertoire", "zoo/qd_hopper") == "repertoire:=zoo/qd_hopper"
