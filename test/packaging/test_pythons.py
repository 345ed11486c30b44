"""The same seed gives the same bits on every supported Python for which `make test-pythons` has set up a copy."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
COPIES = ROOT / "build" / "pythons"
"""Where scripts/test_pythons.sh has a checkout per version of Python."""

SEARCH = """
import hashlib
import json
import sys

from pga_me_ros import Search, Settings, make_task

print(f"{sys.version_info.major}.{sys.version_info.minor}")
settings = Settings.from_mapping(dict(
    task="qd_hopper", seed=3, evaluations=60, random_init=20, batch_size=20, cells=50, cvt_samples=1000,
    controller_hidden=(16, 8), **json.loads(sys.argv[1]),
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


GRADIENTS = {"n_evo": 10, "n_crit": 20, "n_grad": 2, "transition_batch": 32, "critic_hidden": [16]}
"""Settings of a search that trains little."""


def digest_on(python: Path, settings: dict[str, Any]) -> tuple[str, str]:
    """Return the version of an interpreter, and the digest of the elites that it finds."""
    done = subprocess.run(
        [str(python), "-c", SEARCH, json.dumps(settings)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    version, digest = done.stdout.split()[-2:]
    return version, digest


@pytest.mark.parametrize(
    "settings",
    [{"algorithm": "map_elites"}, {"algorithm": "pga_map_elites", **GRADIENTS}],
    ids=["mutations", "gradients"],
)
def test_the_same_seed_gives_the_same_bits_on_every_python(settings: dict[str, Any]) -> None:
    others = sorted(COPIES.glob("*/.venv/bin/python"))
    if not others:
        pytest.skip("no other Python is set up; `make test-pythons` does it")
    _, expected = digest_on(Path(sys.executable), settings)
    found = dict(digest_on(python, settings) for python in others)
    assert found == dict.fromkeys(found, expected)


MAKEFILE = """\
test:
\t@echo "with $(PYTHON), $(WORKERS) workers"; printf '<%s>' $(ARGS); test "$(PYTHON)" != "$(BROKEN)"
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a repository whose `make test` shows what it is given, and in which two Pythons are found."""
    folder = tmp_path / "checkout"
    shutil.copytree(ROOT / "scripts", folder / "scripts", ignore=shutil.ignore_patterns("__py*"))
    (folder / "Makefile").write_text(MAKEFILE)
    for command in (["init", "-q"], ["add", "-A"], [*AUTHOR, "commit", "-qm", "all"]):
        subprocess.run(["git", *command], cwd=folder, check=True)
    (folder / ".venv").mkdir()
    (folder / ".venv/setup.bash").write_text("python() { echo; echo compared; }\n")
    (tmp_path / "bin").mkdir()
    for version in ("3.11", "3.12", "3.13"):
        answer = version if version != "3.13" else "3.14"  # not what its name says
        (tmp_path / f"bin/python{version}").write_text(f"#!/bin/sh\necho {answer}\n")
        (tmp_path / f"bin/python{version}").chmod(0o755)
    return folder


AUTHOR = ["-c", "user.name=tester", "-c", "user.email=tester@example.com"]


def on_all(checkout: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    places = {
        "PATH": f"{checkout.parent / 'bin'}:{os.environ['PATH']}",
        "PYENV_ROOT": str(checkout),
    }
    inherited = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
    return subprocess.run(
        ["scripts/test_pythons.sh", "-m", "not slow"],
        cwd=checkout,
        env={**inherited, **places, "WORKERS": "3", **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_each_python_that_is_found_gets_the_options_as_given(checkout: Path) -> None:
    bin_folder = checkout.parent / "bin"
    for _ in range(2):  # the second time, the checkouts exist
        done = on_all(checkout)
        assert done.returncode == 0, done.stderr
        for version in ("3.11", "3.12"):
            assert f"with {bin_folder}/python{version}, 3 workers\n<-m><not slow>" in done.stdout
        assert "== Python 3.13: not found" in done.stdout
        assert done.stdout.endswith("compared\n")


def test_in_a_shell_with_a_sourced_environment_nothing_is_tested(checkout: Path) -> None:
    done = on_all(checkout, VIRTUAL_ENV="/somewhere/.venv")
    assert (done.returncode, done.stdout) == (2, "")
    assert "error: /somewhere/.venv is sourced in this shell" in done.stderr


def test_a_failure_on_one_python_fails_the_whole(checkout: Path) -> None:
    done = on_all(checkout, BROKEN=str(checkout.parent / "bin/python3.11"))
    assert done.returncode == 1
    assert "python3.12, 3 workers" in done.stdout
