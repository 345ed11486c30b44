"""Options of the nodes that work for one run."""

from __future__ import annotations

import pytest

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.options import require_run


def test_a_node_of_a_run_does_not_start_without_a_run() -> None:
    assert require_run({"run_id": "abc"}, "variation") == "abc"
    with pytest.raises(
        SettingsError, match="variation works for one run, and the run's orchestrator"
    ):
        require_run({"run_id": ""}, "variation")
