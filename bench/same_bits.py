"""Whether this checkout gives the same results as an older revision, bit for bit.

Run: `make same-bits REV=HEAD~3`, or `.venv/bin/python bench/same_bits.py REV [--digests FILE]`; the last line is JSON,
the exit code 0 only if every run has the same bits. Both trees do tiny runs of all algorithms on two tasks in one
process, and one run by the node graph. Compared are the offspring, episodes and metrics of every generation, the
elites, and what was learned.

The older revision is checked out into a temporary folder, but uses this checkout's environment. So its graph cannot
run if the message definitions have changed. To compare it nevertheless, save its digests before, with `--digests`: the
file is written if it does not exist, and replaces the older runs if it does. Digests are valid for one machine type and
one set of library versions.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PER_GENERATION = ("offspring", "episodes", "metrics")
"""Parts of a run that have a digest per generation."""

Runs = dict[str, dict[str, list[str]]]
"""Digests by run and part."""


def git(*arguments: str) -> str:
    """Return the output of a git command.

    Raises:
        SystemExit: The command failed.
    """
    done = subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"git {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout.strip()


@contextmanager
def checked_out(revision: str) -> Iterator[Path]:
    """Check out a revision into a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git("worktree", "add", "--detach", str(tree), revision)
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))


def digests_of(tree: Path, *options: str) -> Runs:
    """Carry out all runs with the code of a source tree.

    Raises:
        SystemExit: A run failed.
    """
    command = [sys.executable, str(ROOT / "bench/_digests.py"), str(tree), *options]
    done = subprocess.run(
        command,
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"The runs with the code of '{tree}' failed:\n{done.stderr}")
    runs: Runs = json.loads(done.stdout.splitlines()[-1])
    return runs


def older_digests(revision: str) -> Runs:
    """Carry out all runs with the code of a revision; that of the graph only if it can run here."""
    changed = git("diff", "--name-only", revision, "--", "msg_defs")
    with checked_out(revision) as tree:
        return digests_of(tree, *(["no-graph"] if changed else []))


def saved_digests(file: Path, revision: str) -> Runs:
    """Return the digests that an earlier call saved.

    Raises:
        SystemExit: The digests are those of another revision.
    """
    saved = json.loads(file.read_text())
    if saved["revision"] != revision:
        raise SystemExit(
            f"'{file}' has the digests of {saved['revision']}, not of {revision}; give another file, or that revision."
        )
    runs: Runs = saved["runs"]
    return runs


def difference(older: dict[str, list[str]], ours: dict[str, list[str]]) -> str:
    """Return where two runs differ, as text; empty if they do not."""
    parts = [name for name in {**older, **ours} if older.get(name) != ours.get(name)]
    if not parts:
        return ""
    first = [
        t
        for name in PER_GENERATION
        for t, (a, b) in enumerate(zip_longest(older.get(name, ()), ours.get(name, ())))
        if a != b
    ]
    since = f"since generation {min(first)}: " if first else ""
    return since + ", ".join(parts)


def compare(older: Runs, ours: Runs) -> dict[str, str]:
    """Print one row per run; return, by run, 'same' or where they differ."""
    rows = {}
    for name, digests in ours.items():
        if name not in older:
            print(
                f"not compared  {name}: there are no older digests; msg_defs has changed since, or it is new."
            )
            continue
        rows[name] = difference(older[name], digests) or "same"
        same = rows[name] == "same"
        print(f"same          {name}" if same else f"DIFFERENT     {name}, {rows[name]}")
    return rows


def main() -> int:
    """Run, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("revision", help="older revision, as git names it")
    parser.add_argument("--digests", type=Path, help="file to keep the older digests in")
    arguments = parser.parse_args()
    revision = git("rev-parse", "--verify", f"{arguments.revision}^{{commit}}")
    file = arguments.digests
    with ThreadPoolExecutor() as threads:
        ours = threads.submit(digests_of, ROOT)
        if file and file.exists():
            older = saved_digests(file, revision)
        else:
            older = older_digests(revision)
            if file:
                file.write_text(json.dumps({"revision": revision, "runs": older}, indent=1))
        rows = compare(older, ours.result())
    print(json.dumps({"bench": "same_bits", "figures": rows}))
    return int(any(row != "same" for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main())
