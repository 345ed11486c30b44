"""The library example runs unchanged, and the page quotes it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from commands import ROOT, blocks
from PIL import Image

from pga_me_ros.core.storage.stored_run import StoredRun

EXAMPLE = ROOT / "examples" / "library.py"


def test_the_example_grows_stores_and_draws_a_repertoire(tmp_path: Path) -> None:
    command = [sys.executable, str(EXAMPLE), str(tmp_path / "run")]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    run = StoredRun.load(tmp_path / "run")
    behavior = run.choose(descriptor=[0.4])
    assert f"QD-score {run.metrics[-1].qd_score:.0f}" in result.stdout
    assert f"fitness {behavior.fitness:.1f} when found" in result.stdout
    with Image.open(tmp_path / "run" / "behavior.gif") as picture:
        assert picture.n_frames > 1


def test_the_page_quotes_the_example() -> None:
    code = EXAMPLE.read_text().partition('"""\n\n')[2]
    assert code in blocks("library.md", "python")
