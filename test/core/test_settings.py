"""Settings: the paper's defaults, and words for every value that cannot be."""

from __future__ import annotations

from typing import Any

import pytest

from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.settings import RATES, Settings, identity_difference

TABLE_1 = {
    "controller_hidden": (128, 128),
    "critic_hidden": (256, 256),
    "evaluations": 10**6,
    "random_init": 500,
    "batch_size": 100,
    "n_crit": 300,
    "critic_learning_rate": 3e-4,
    "greedy_learning_rate": 3e-4,
    "transition_batch": 256,
    "replay_size": 10**6,
    "discount": 0.99,
    "target_rate": 0.005,
    "smoothing_sigma": 0.2,
    "smoothing_clip": 0.5,
    "target_period": 2,
    "n_evo": 50,
    "n_grad": 10,
    "pg_learning_rate": 0.001,
    "iso_sigma": 0.005,
    "line_sigma": 0.05,
}


def test_the_defaults_are_table_1() -> None:
    assert TABLE_1.items() <= vars(Settings()).items()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("evaluations", 0, "evaluations is 0; expected a value from 1 to"),
        ("evaluations", "abc", r"evaluations must be an integer, not 'abc' \(str\)"),
        ("evaluations", 1.5, r"evaluations must be an integer, not 1.5 \(float\)"),
        ("evaluations", float("nan"), "evaluations must be an integer, not nan"),
        ("evaluations", float("inf"), "evaluations must be an integer, not inf"),
        ("evaluations", True, r"not True \(bool\)"),
        ("iso_sigma", -0.1, "iso_sigma is -0.1; expected a value from 0.0 to 100.0"),
        ("iso_sigma", float("nan"), "iso_sigma is nan; expected"),
        ("iso_sigma", True, r"iso_sigma must be a number, not True \(bool\)"),
        ("task", 5, "task must be a string, not 5 .*in quotes"),
        (
            "archive",
            "gird",
            r"archive is 'gird' \(did you mean 'grid'\?\); expected one of: cvt, grid",
        ),
        ("controller_hidden", 128, "controller_hidden must be a list of integers, not 128"),
        ("controller_hidden", "128", "controller_hidden must be a list of integers, not '128'"),
        ("controller_hidden", [], "at least one layer"),
        ("controller_hidden", [128, 0], "controller_hidden is 0; expected a value from 1"),
        ("controller_hidden", [128, "a"], "controller_hidden must be an integer, not 'a'"),
        ("n_evo", 101, "n_evo is 101, but a batch has batch_size=100.*from 0 to 100"),
    ],
)
def test_a_value_that_cannot_be_is_refused(name: str, value: Any, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        Settings.from_mapping({name: value})


def test_an_unknown_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(SettingsError, match=r"'evaluatons' \(did you mean 'evaluations'\?\)"):
        Settings.from_mapping({"evaluatons": 5})


@pytest.mark.parametrize(
    ("name", "given", "taken"),
    [("iso_sigma", 1, 1.0), ("evaluations", 1e6, 1_000_000), ("critic_hidden", [8], (8,))],
)
def test_a_value_is_taken_in_the_type_of_its_setting(name: str, given: Any, taken: Any) -> None:
    value = getattr(Settings.from_mapping({name: given}), name)
    assert (value, type(value)) == (taken, type(taken))


def test_settings_survive_their_dictionary() -> None:
    settings = Settings(task="qd_ant", controller_hidden=(3, 4), iso_sigma=0.1)
    assert Settings.from_mapping(settings.to_dict()) == settings


@pytest.mark.parametrize(
    ("random_init", "batch_size", "generations"), [(500, 100, 5), (501, 100, 6), (1, 100, 1)]
)
def test_random_controllers_come_in_whole_batches(
    random_init: int, batch_size: int, generations: int
) -> None:
    settings = Settings(random_init=random_init, batch_size=batch_size)
    assert settings.init_generations == generations


def test_rates_and_budget_are_no_part_of_a_runs_identity() -> None:
    changed = {name: getattr(Settings(), name) for name in RATES} | {"evaluations": 5, "n_evo": 3}
    assert identity_difference(Settings(), Settings(**changed)) == []


def test_every_other_setting_is_part_of_it() -> None:
    other = Settings(seed=1, terminal="bootstrap")
    expected = ["seed: 0 != 1", "terminal: mask != bootstrap"]
    assert identity_difference(Settings(), other) == expected
