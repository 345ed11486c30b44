"""A subscriber to an archive's pictures must not end the node that serves it, whatever the archive's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from graph import Graph, Probe, wait_until
from pga_me_msgs.srv import GetInfo
from sensor_msgs.msg import Image

from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.metrics import generation_metrics
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.ros import qos
from pga_me_ros.tasks.registry import task_spec

WIDTH = 240


def store(path: Path, settings: Settings) -> None:
    """Write a repertoire of one generation with a few elites."""
    spec, rng = task_spec(settings.task), np.random.default_rng(1)
    sizes = controller_shape(spec, settings).sizes
    about = (settings.to_dict(), spec.to_json(), sizes, ("relu", "tanh"), {}, "2026-01-01T00:00:00")
    archive = make_archive(spec, settings)
    batch = Solutions.of(
        fitness=rng.random(20),
        descriptors=rng.random((20, spec.descriptor_dim)),
        parameters=np.zeros((20, archive.parameter_count)),
        evaluations=range(20),
    )
    with Repertoire.create(path, RunInfo("run-of-the-tests", *about), archive) as file:
        added = archive.add(batch)
        elites = [archive.elite(cell) for cell in added.changed_cells.tolist()]
        file.commit(0, elites, generation_metrics(archive, batch, added, 0, None), {})


@pytest.mark.parametrize(
    "settings",
    [
        Settings(task="qd_hopper", archive="grid", controller_hidden=(4,)),
        Settings(task="qd_hopper", cells=2000, cvt_samples=4000, controller_hidden=(4,)),
        Settings(task="qd_ant", archive="grid", controller_hidden=(4,)),
        Settings(task="qd_ant", cells=3, cvt_samples=300, controller_hidden=(4,)),
    ],
    ids=["1000 bins", "2000 cells", "6 x 6 x 6 x 6", "3 cells of 4 dimensions"],
)
def test_a_picture_of_any_archive_is_published(
    settings: Settings, graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    path = tmp_path / "repertoire.db"
    store(path, settings)
    manager = graph.start("archive_manager", {"repertoire": path, "grow": False})
    pictures = probe.listen(Image, "repertoire/heatmap", qos.LATCHED)

    def shown() -> bool:
        assert manager.process.poll() is None, manager.output
        return bool(pictures)

    wait_until(shown, "a picture")
    assert 1 <= pictures[0].width <= WIDTH
    assert 1 <= pictures[0].height <= WIDTH
    assert len(pictures[0].data) == 3 * pictures[0].width * pictures[0].height
    assert probe.call(GetInfo, "repertoire/get_info").run_id == "run-of-the-tests"
