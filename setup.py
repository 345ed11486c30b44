"""Package description for pip and colcon."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "pga_me_ros"

# Each link in resource/executables is an executable: `ros2 run pga_me_ros <name>` runs main() of
# pga_me_ros/nodes/<name>.py. To add one: ln -s ../start_node resource/executables/<name>
EXECUTABLES = sorted(
    link.name for link in (Path(__file__).resolve().parent / "resource/executables").iterdir()
)

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Grows, by PGA-MAP-Elites, a repertoire of gaits that other nodes can query.",
    author="pga_me_ros maintainers",
    author_email="maintainers@pga-me-ros.org",
    maintainer="pga_me_ros maintainers",
    maintainer_email="maintainers@pga-me-ros.org",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    # What the nodes import is declared in package.xml, and pinned in requirements/run.txt.
    install_requires=["setuptools"],
    entry_points={
        "console_scripts": [f"{name} = {PACKAGE}.nodes.{name}:main" for name in EXECUTABLES]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(glob("config/*.yaml"))),
        (f"lib/{PACKAGE}", [f"resource/executables/{name}" for name in EXECUTABLES]),
    ],
    zip_safe=False,
)
