"""Settings: the paper's defaults, and an error for every invalid value."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest

from pga_me_ros.core.algorithms import ALGORITHMS
from pga_me_ros.core.archive.make_archive import ARCHIVES
from pga_me_ros.core.settings import RATES, Settings, identity_difference
from pga_me_ros.core.settings.rules import RULES
from pga_me_ros.core.settings.run import ALGORITHM_NAMES, ARCHIVE_KINDS
from pga_me_ros.errors import SettingsError

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
        ("task", ["a", "b"], r"task must be a string, not \['a', 'b'\] \(list\)\.$"),
        (
            "start_from",
            ["a", "b"],
            r"start_from must be a string.*\(list\); write start_from: \"a, b\"\.$",
        ),
        ("start_from", "a,,b", "start_from: 'a,,b' has an empty entry"),
        ("start_from", "a, ~nobody_here/b", "start_from: '~nobody_here/b' begins with"),
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
def test_an_invalid_value_is_refused(name: str, value: Any, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        Settings.from_mapping({name: value})


def test_an_unknown_name_is_refused_with_a_suggestion() -> None:
    with pytest.raises(SettingsError, match=r"'evaluatons' \(did you mean 'evaluations'\?\)"):
        Settings.from_mapping({"evaluatons": 5})


@pytest.mark.parametrize(
    ("name", "given", "taken"),
    [("iso_sigma", 1, 1.0), ("evaluations", 1e6, 1_000_000), ("critic_hidden", [8], (8,))],
)
def test_a_value_is_converted_to_the_type_of_its_setting(name: str, given: Any, taken: Any) -> None:
    value = getattr(Settings.from_mapping({name: given}), name)
    assert (value, type(value)) == (taken, type(taken))


def test_settings_survive_conversion_to_a_dictionary() -> None:
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


def test_rates_and_budget_are_not_part_of_a_runs_identity() -> None:
    changed = {name: getattr(Settings(), name) for name in RATES} | {"evaluations": 5, "n_evo": 3}
    assert identity_difference(Settings(), Settings(**changed)) == []


def test_every_other_setting_is_part_of_it() -> None:
    other = Settings(seed=1, terminal="bootstrap")
    expected = ["seed: 0 != 1", "terminal: mask != bootstrap"]
    assert identity_difference(Settings(), other) == expected


@pytest.mark.parametrize(
    ("algorithm", "name", "value"),
    [
        ("map_elites", "n_evo", 50),
        ("map_elites", "n_grad", 20),
        ("pg_only", "n_evo", 50),
        ("pg_only", "iso_sigma", 0.01),
        ("td3", "n_evo", 50),
        ("td3", "n_crit", 200),
        ("td3", "schedule", "overlapped"),
        ("td3", "critic_start", "last_init_batch"),
        ("qd_rl", "schedule", "overlapped"),
        ("map_elites_es", "replay_size", 1_000_000),
        ("map_elites_es", "random_init", 500),
        ("map_elites_es", "start_from", "other"),
        ("pga_map_elites", "es_samples", 100),
        ("pga_map_elites", "exploration_sigma", 0.2),
        ("pga_map_elites", "novelty_neighbors", 3),
        ("pga_map_elites", "similarity_length", 0.2),
        ("dcrl_map_elites", "greedy_init", "best"),
        ("dcrl_map_elites", "greedy_takes", "ga"),
    ],
)
def test_a_value_that_would_change_nothing_is_refused(
    algorithm: str, name: str, value: Any
) -> None:
    with pytest.raises(SettingsError, match=rf"{name} is .*{algorithm}.*; remove {name}\."):
        Settings.from_mapping({"algorithm": algorithm, name: value})


@pytest.mark.parametrize(("name", "value"), [("cells", 100), ("cvt_samples", 5000)])
def test_a_grid_refuses_settings_of_a_tessellation(name: str, value: int) -> None:
    with pytest.raises(SettingsError, match=f"a grid archive doesn't use it; remove {name}"):
        Settings.from_mapping({"archive": "grid", name: value})


@pytest.mark.parametrize(
    ("algorithm", "expected"),
    [
        ("pga_map_elites", {"batch_size": 100, "n_evo": 50, "schedule": "overlapped"}),
        ("map_elites", {"batch_size": 100, "n_evo": 100, "random_init": 500}),
        ("pg_only", {"batch_size": 100, "n_evo": 0, "schedule": "overlapped"}),
        ("td3", {"batch_size": 10, "n_evo": 0, "schedule": "alternating"}),
        ("map_elites_es", {"batch_size": 1001, "random_init": 1, "replay_size": 1}),
        ("qd_rl", {"batch_size": 4, "n_evo": 0, "schedule": "alternating"}),
        ("qd_rl", {"n_crit": 300, "n_grad": 10, "transition_batch": 256}),
        ("dcrl_map_elites", {"batch_size": 256, "n_evo": 128, "schedule": "overlapped"}),
    ],
)
def test_the_name_of_an_algorithm_sets_its_own_values(
    algorithm: str, expected: dict[str, Any]
) -> None:
    assert expected.items() <= vars(Settings(algorithm=algorithm)).items()


@pytest.mark.parametrize("algorithm", ["td3", "qd_rl", "pga_map_elites"])
def test_a_value_equal_to_another_algorithms_own_counts(algorithm: str) -> None:
    assert Settings(algorithm=algorithm, batch_size=100).batch_size == 100


def test_values_that_belong_together_follow_one_another() -> None:
    assert Settings(batch_size=50).n_evo == 25
    assert Settings().replace(batch_size=40).n_evo == 20
    assert Settings(batch_size=50, n_evo=50).n_evo == 50
    es = Settings(algorithm="map_elites_es", es_samples=20)
    assert es.replace(es_samples=40).batch_size == 41


@pytest.mark.parametrize("algorithm", list(RULES))
def test_the_given_values_recreate_the_settings(algorithm: str) -> None:
    settings = Settings(algorithm=algorithm, seed=4, controller_hidden=(3, 4))
    assert Settings.from_mapping(settings.given) == settings
    assert Settings.from_stored(settings.to_dict()) == settings
    assert settings.with_rates(settings.rates) == settings


def test_settings_that_an_older_version_stored_are_read() -> None:
    """Older versions stored the general default of a setting that an algorithm does not use."""
    stored = {**Settings(algorithm="map_elites").to_dict(), "n_evo": 50, "schedule": "overlapped"}
    assert Settings.from_stored(stored) == Settings(algorithm="map_elites")
    grid = {**Settings(archive="grid").to_dict(), "cells": 100}
    assert Settings.from_stored(grid) == Settings(archive="grid")


def test_every_algorithm_has_its_name_and_its_rules() -> None:
    assert list(ALGORITHM_NAMES) == list(RULES) == list(ALGORITHMS)


def test_every_part_of_a_setting_belongs_to_an_algorithm() -> None:
    parts = {f.metadata["part"] for f in fields(Settings)} - {""}
    assert parts - {*ARCHIVE_KINDS} == {part for rules in RULES.values() for part in rules.parts}


def test_every_kind_of_archive_has_its_name() -> None:
    assert list(ARCHIVE_KINDS) == list(ARCHIVES)


def test_the_rates_of_a_generation_have_explicit_values() -> None:
    with pytest.raises(SettingsError, match="n_evo is -1, which stands for"):
        Settings().with_rates({**Settings().rates, "n_evo": -1})
