"""Room for messages in transit: a generation's controllers fit, so that nothing is dropped and resent."""

from __future__ import annotations

import subprocess
import sys

from domain_coordinator import domain_id

from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.ros.dds_choices import PROFILES, QOS_FROM_PROFILES
from pga_me_ros.tasks.registry import load_task

LARGEST_SEGMENT = """
import rclpy
from pathlib import Path
from pga_me_ros.ros.environment import prepare_environment

prepare_environment()
rclpy.init()
node = rclpy.create_node("spacious")
lines = Path("/proc/self/maps").read_text().splitlines()
segments = [line.split()[0] for line in lines if "/dev/shm/fastrtps_" in line and "_port" not in line]
# The mapping counts, not its file, whose name another participant may just be tidying up.
bounds = [[int(address, 16) for address in segment.split("-")] for segment in segments]
print(max(end - begin for begin, end in bounds))
rclpy.shutdown()
"""


def largest_segment(monkeypatch):
    """Return the size in bytes of the shared memory to which one of our nodes writes its messages."""
    for name in (*PROFILES, QOS_FROM_PROFILES):
        monkeypatch.delenv(name, raising=False)
    with domain_id() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        out = subprocess.run(
            [sys.executable, "-c", LARGEST_SEGMENT], capture_output=True, text=True, check=True
        )
    return int(out.stdout.splitlines()[-1])


def test_controllers_of_a_generation_fit_into_shared_memory(monkeypatch):
    room = largest_segment(monkeypatch)
    settings = Settings()
    for task in ("qd_walker", "qd_half_cheetah", "qd_ant", "qd_hopper"):
        shape = controller_shape(load_task(task).spec, settings)
        assert room > 4 * shape.parameter_count * settings.batch_size
