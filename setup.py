"""Package description for pip and colcon."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.develop import develop

PACKAGE = "pga_me_ros"

# Each link in resource/executables is an executable: `ros2 run pga_me_ros <name>` runs main() of
# pga_me_ros/nodes/<name>.py. To add one: ln -s ../start_node resource/executables/<name>
# Other programs are packages whose __main__.py has a main(): ln -s ../start_program resource/executables/<name>
ROOT = Path(__file__).resolve().parent
EXECUTABLES = sorted(link.name for link in (ROOT / "resource/executables").iterdir())
PROGRAMS = [name for name in EXECUTABLES if (ROOT / PACKAGE / name / "__main__.py").exists()]
MODULES = {
    name: f"{name}.__main__" if name in PROGRAMS else f"nodes.{name}" for name in EXECUTABLES
}


class DevelopWithoutScripts(develop):
    """What ``colcon build --symlink-install`` runs.

    The executables among data_files are linked into lib/pga_me_ros and run in the Python on PATH. Scripts of the entry
    points would take their place, with the path of the interpreter that builds.
    """

    def install_wrapper_scripts(self, dist):
        """Write none."""


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
    package_data={
        f"{PACKAGE}.ros": ["*.xml"],
        f"{PACKAGE}.report": ["*.csv"],
        f"{PACKAGE}.explorer": ["web/*"],
    },
    # The nodes' dependencies are declared in package.xml and pinned in requirements/run.txt.
    install_requires=["setuptools"],
    # Dependencies of one format of `export`, of recordings, of tasks from Gymnasium, of the explorer, of TensorBoard
    # events, and of the tests that `colcon test` runs (colcon.pkg names them): it runs none unless pytest is here.
    extras_require={
        "onnx": ["onnx"],
        "record": ["rosbags"],
        "test": ["hypothesis", "pytest", "pytest-timeout"],
        "mujoco": ["gymnasium[mujoco]"],
        "tensorboard": ["tensorboard"],
        "web": ["jupyter-threejs-sage==130", "starlette", "uvicorn"],
    },
    entry_points={
        "console_scripts": [f"{name} = {PACKAGE}.{module}:main" for name, module in MODULES.items()]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *(
            (f"share/{PACKAGE}/{folder}", sorted(glob(f"{folder}/*.*")))
            for folder in ["repertoires", *sorted(glob("repertoires/*/"))]
        ),
        (f"share/{PACKAGE}/config", sorted(glob("config/*.*"))),
        (f"share/{PACKAGE}/config/experiments", sorted(glob("config/experiments/*"))),
        (f"share/{PACKAGE}/config/hardware", sorted(glob("config/hardware/*"))),
        (f"share/{PACKAGE}/config/presets", sorted(glob("config/presets/*"))),
        (f"lib/{PACKAGE}", [f"resource/executables/{name}" for name in EXECUTABLES]),
    ],
    cmdclass={"develop": DevelopWithoutScripts},
    zip_safe=False,
)
