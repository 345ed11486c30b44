"""The figure of all records in docs/results."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from result_curves import DOCS, draw, read

RECORDS = sorted((DOCS / "results").glob("*.csv"))


def test_the_name_of_a_record_says_what_was_run(tmp_path: Path) -> None:
    file = tmp_path / "qd_ant-dcrl_map_elites-n_crit12000-seed7.csv"
    file.write_text("evaluations,coverage\n256,27\n512,110\n")
    task, variant, record = read(file)
    assert (task, variant) == ("qd_ant", "dcrl_map_elites, n_crit 12000")
    np.testing.assert_array_equal(record["coverage"], [27.0, 110.0])
    plain = file.rename(tmp_path / "qd_ant-seed7.csv")
    assert read(plain)[:2] == ("qd_ant", "pga_map_elites")
    other = plain.rename(tmp_path / "qd_ant-td3-first_walk-seed7.csv")
    assert read(other)[:2] == ("qd_ant", "td3, first_walk")


def test_every_record_is_in_the_figure(tmp_path: Path) -> None:
    _, svg = draw(RECORDS, tmp_path)
    text = svg.read_text()  # matplotlib repeats each text as a comment
    for file in RECORDS:
        task, variant, _ = read(file)
        assert f"<!-- {task} -->" in text
        assert f"<!-- {variant} -->" in text
    assert "authors' median" in text


@pytest.mark.parametrize("file", RECORDS, ids=lambda file: file.stem)
def test_a_record_goes_up_in_evaluations(file: Path) -> None:
    _, _, record = read(file)
    assert (np.diff(record["evaluations"]) > 0).all()
    assert (np.diff(record["max_fitness"]) >= 0).all()
