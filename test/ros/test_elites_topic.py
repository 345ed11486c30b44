"""A mirror of archive/elites has the archive's elites, and refuses messages that cannot belong to it."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
import pytest
from pga_me_msgs.msg import Elites

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.elites_topic import EliteMirror, elites_to_msg

CELLS, P, D, B = 12, 5, 2, 10


def batch(generation: int) -> Solutions:
    rng = np.random.default_rng(generation)
    return Solutions.of(
        fitness=rng.standard_normal(B),
        descriptors=rng.random((B, D)),
        parameters=rng.standard_normal((B, P)).astype(np.float32),
        evaluations=range(B * generation, B * generation + B),
        generation=generation,
    )


def grown(generations: int) -> tuple[Archive, EliteMirror]:
    """Return an archive and a mirror that received each generation's changes."""
    archive = GridArchive((4, 3), (0.0, 0.0), (1.0, 1.0), P)
    mirror = EliteMirror(CELLS, P, D)
    for generation in range(generations):
        changed = archive.add(batch(generation)).changed_cells
        mirror.hear(elites_to_msg(archive, "r", generation, changed))
    return archive, mirror


def test_it_has_all_present_elites_and_no_replaced_ones() -> None:
    archive, mirror = grown(8)
    cells = archive.filled_cells()
    ids = archive.evaluations[cells]
    np.testing.assert_array_equal(mirror.parameters(ids), archive.parameters[cells])
    np.testing.assert_array_equal(mirror.descriptors(ids), archive.descriptors[cells])
    pairs = np.stack([ids, ids[::-1]], axis=1)
    assert mirror.parameters(pairs).shape == (len(ids), 2, P)
    np.testing.assert_array_equal(mirror.descriptors(pairs)[:, 1], archive.descriptors[cells[::-1]])
    others = sorted(set(range(8 * B)) - set(ids.tolist()))
    assert len(others) > 8 * B - CELLS - 1
    assert mirror.lacking(np.arange(8 * B)) == others


def test_missed_elites_can_be_received_later_and_twice() -> None:
    archive, _ = grown(8)
    cells = archive.filled_cells()
    ids = archive.evaluations[cells]
    late = EliteMirror(CELLS, P, D)
    assert late.lacking(ids) == sorted(ids.tolist())
    for some in (cells[:3], cells):
        late.hear(elites_to_msg(archive, "r", 7, some))
    assert late.lacking(ids) == []
    np.testing.assert_array_equal(late.parameters(ids), archive.parameters[cells])


def test_all_are_lacking_before_the_changes_of_their_generation_were_heard() -> None:
    archive, mirror = grown(8)
    ids = archive.evaluations[archive.filled_cells()]
    assert mirror.generation == 7
    assert mirror.lacking(ids, 7) == []
    assert mirror.lacking(ids, 8) == sorted(ids.tolist())
    mirror.hear(elites_to_msg(archive, "r", 8, archive.filled_cells()[:1]))
    assert mirror.lacking(ids, 8) == []


def test_what_is_published_again_says_nothing_about_the_others() -> None:
    archive, mirror = grown(8)
    cells = archive.filled_cells()
    ids = archive.evaluations[cells]
    mirror.hear(
        elites_to_msg(archive, "r", 8, cells[:2], again=True)
    )  # the changes of 8 are missed
    assert mirror.lacking(ids, 8) == sorted(ids[2:].tolist())
    assert mirror.lacking(ids, 7) == []
    mirror.hear(elites_to_msg(archive, "r", 9, cells[2:4]))
    assert mirror.lacking(ids, 9) == sorted(ids[4:].tolist())  # any of them may have changed in 8
    mirror.hear(elites_to_msg(archive, "r", 9, cells[4:], again=True))
    mirror.hear(elites_to_msg(archive, "r", 10, cells[:1]))
    assert mirror.lacking(ids, 10) == []


def test_no_parents_are_none() -> None:
    nobody = np.empty((7, 0), np.int64)
    assert EliteMirror(CELLS, P, D).parameters(nobody).shape == (7, 0, P)
    assert EliteMirror(CELLS, P, D).descriptors(nobody).shape == (7, 0, D)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"generation": -1}, "'generation' is -1"),
        ({"cells": [0, CELLS]}, "'cells' holds 0 to 12; expected 0 to 11"),
        ({"cells": [-1, 0]}, "'cells' holds -1 to 0"),
        ({"cells": [3, 3]}, "'cells' holds a number twice"),
        ({"cells": [3]}, "'evaluations' has 2 entries"),
        ({"evaluations": [900, -1]}, "'evaluations' holds -1 to 900"),
        ({"evaluations": [900, 900]}, "'evaluations' holds a number twice"),
        ({"parameters": [0.0] * (2 * P - 1)}, "'parameters' has 9 entries"),
        ({"parameters": [0.0] * (2 * P - 1) + [np.nan]}, "'parameters' holds NaN"),
        ({"descriptors": [0.0] * 3}, "'descriptors' has 3 entries"),
        ({"descriptors": [0.0, 0.0, 0.0, np.inf]}, "'descriptors' holds NaN or infinity"),
    ],
)
def test_messages_that_cannot_belong_to_the_archive_are_refused_as_a_whole(
    changes: dict[str, list[Any]], words: str
) -> None:
    archive, mirror = grown(3)
    sound: dict[str, Any] = {
        "run_id": "r",
        "generation": 3,
        "cells": array.array("q", [0, 1]),
        "evaluations": array.array("q", [900, 901]),
        "parameters": array.array("f", [0.0] * (2 * P)),
        "descriptors": array.array("d", [0.0] * (2 * D)),
    }
    with pytest.raises(RequestError, match=words):
        mirror.hear(Elites(**{**sound, **changes}))
    cells = archive.filled_cells()
    kept = mirror.parameters(archive.evaluations[cells])
    np.testing.assert_array_equal(kept, archive.parameters[cells])
    assert mirror.lacking(np.array([900, 901])) == [900, 901]
