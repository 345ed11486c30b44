"""Numbers on command lines."""

from __future__ import annotations

import pytest

from pga_me_ros.adapt_demo import plan
from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.query import __main__ as query
from pga_me_ros.replay import __main__ as replay


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


@pytest.mark.parametrize("program", [query, replay, plan])
def test_programs_that_take_numbers_read_them_so(program) -> None:
    assert isinstance(program._parser(), ArgumentParser)


def test_a_query_takes_them() -> None:
    options = query._parser().parse_args(["--descriptor", "-1e-3", "2", "--min-fitness", "-inf"])
    assert (options.descriptor, options.min_fitness) == ([-1e-3, 2.0], float("-inf"))
