"""The same seed gives the same bits on every supported Python for which `make test-pythons` has set up a copy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COPIES = ROOT / "build" / "pythons"
"""Where scripts/test_pythons.sh has a checkout per version of Python."""

SEARCH = """
import hashlib
import sys

from pga_me_ros import Search, Settings, make_task

print(f"{sys.version_info.major}.{sys.version_info.minor}")
settings = Settings.from_mapping(dict(
    task="qd_hopper", algorithm="map_elites", seed=3, evaluations=60, random_init=20, batch_size=20, cells=50,
    cvt_samples=1000, controller_hidden=(16, 8),
))
task = make_task(settings.task)
search = Search(task.spec, settings)
for _ in range(settings.generations):
    search.run_generation(task)
task.close()
digest = hashlib.sha256()
for elite in search.archive.elites():
    digest.update(elite.parameters.tobytes() + elite.descriptor.tobytes() + repr(elite.fitness).encode())
print(digest.hexdigest())
"""


def digest_on(python: Path) -> tuple[str, str]:
    """Return the version of an interpreter, and the digest of the elites that it finds."""
    done = subprocess.run(
        [str(python), "-c", SEARCH],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    version, digest = done.stdout.split()[-2:]
    return version, digest


def test_the_same_seed_gives_the_same_bits_on_every_python() -> None:
    others = sorted(COPIES.glob("*/.venv/bin/python"))
    if not others:
        pytest.skip("no other Python is set up; `make test-pythons` does it")
    _, expected = digest_on(Path(sys.executable))
    found = dict(digest_on(python) for python in others)
    assert found == dict.fromkeys(found, expected)
