"""The empty archive for a task and settings."""

from __future__ import annotations

import numpy as np
import pytest
from lane_task import Lane

from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import ArchiveError
from pga_me_ros.tasks.registry import BUILT_IN, task_spec

QUICK = Settings(cvt_samples=3000)
GRID = Settings(archive="grid")


def test_cvt_is_the_default_with_the_cells_of_the_task():
    archive = make_archive(Lane.spec, QUICK)
    assert isinstance(archive, CvtArchive)
    assert archive.cells == Lane.spec.archive_cells


def test_settings_may_change_the_number_of_cells():
    assert make_archive(Lane.spec, QUICK.replace(cells=7)).cells == 7


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_grid_has_the_bins_of_the_task(name):
    spec = task_spec(name)
    archive = make_archive(spec, GRID)
    assert isinstance(archive, GridArchive)
    assert archive.bins == spec.archive_bins
    assert archive.cells == spec.archive_cells


def test_all_seeds_share_their_centroids():
    one, other = (make_archive(Lane.spec, QUICK.replace(seed=seed)) for seed in (0, 9))
    np.testing.assert_array_equal(one.centroids, other.centroids)


def test_archive_is_empty_and_accepts_controllers_of_the_task():
    archive = make_archive(Lane.spec, QUICK.replace(controller_hidden=(4,)))
    assert archive.coverage == 0
    assert archive.parameter_count == (2 + 1) * 4 + (4 + 1) * 2


def test_bounds_are_those_of_the_task():
    archive = make_archive(task_spec("qd_ant"), GRID)
    assert (list(archive.low), list(archive.high)) == ([0.0] * 4, [1.0] * 4)


def test_fewer_samples_than_cells_are_refused():
    with pytest.raises(ArchiveError, match="16 cells cannot be made of 3 samples"):
        make_archive(Lane.spec, QUICK.replace(cvt_samples=3))
