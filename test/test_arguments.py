"""Numbers on command lines."""

from __future__ import annotations

from pathlib import Path

import pytest

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.query import __main__ as query


@pytest.mark.parametrize(
    "word", ["-1", "-0.5", "-1e-3", "-1E3", "-1.", "-.5e+2", "-inf", "-Infinity"]
)
def test_a_negative_number_is_no_option(word: str) -> None:
    parser = ArgumentParser()
    parser.add_argument("--numbers", type=float, nargs="+")
    parser.add_argument("-k", action="store_true")
    given = parser.parse_args(["--numbers", "1", word, "-k"])
    assert given.numbers == [1.0, float(word)]
    assert given.k


@pytest.mark.parametrize("word", ["-x", "-1x", "-e3", "-infer", "-"])
def test_what_is_no_number_is_still_refused(word: str) -> None:
    parser = ArgumentParser()
    parser.add_argument("--numbers", type=float, nargs="+")
    with pytest.raises(SystemExit):
        parser.parse_args(["--numbers", "1", word])


def test_every_program_reads_numbers_so() -> None:
    package = Path(query.__file__).parents[1]
    others = [
        file for file in package.rglob("*.py") if "argparse.ArgumentParser(" in file.read_text()
    ]
    assert others == []


def test_a_query_takes_them() -> None:
    options = query._parser().parse_args(["--descriptor", "-1e-3", "2", "--min-fitness", "-inf"])
    assert (options.descriptor, options.min_fitness) == ([-1e-3, 2.0], float("-inf"))
