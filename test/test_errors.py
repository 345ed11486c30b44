"""Errors: one base class, and suggestions for misspelled names."""

from __future__ import annotations

import pytest

from pga_me_ros import errors
from pga_me_ros.errors import PgaError, nearest_name


@pytest.mark.parametrize(
    "kind",
    ["SettingsError", "TaskError", "NetworkError", "ArchiveError", "StorageError", "RequestError"],
)
def test_every_error_is_a_pga_error_and_a_value_error(kind):
    error = getattr(errors, kind)("text")
    assert isinstance(error, PgaError)
    assert isinstance(error, ValueError)
    assert str(error) == "text"


def test_the_nearest_name_is_suggested():
    assert nearest_name("qd_wlker", ["qd_ant", "qd_walker"]) == " (did you mean 'qd_walker'?)"


def test_nothing_is_suggested_for_a_name_unlike_all_others():
    assert nearest_name("zebra", ["qd_ant", "qd_walker"]) == ""
