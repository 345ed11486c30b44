"""What a run has committed so far, and when; shared by the benches of the graph. Not a bench itself."""

from __future__ import annotations

import sqlite3
from datetime import datetime
from pathlib import Path
from typing import Any


def committed(file: Path) -> list[float]:
    """Return when each generation was committed, s; empty if there is no file yet."""
    return [datetime.fromisoformat(text).timestamp() for text in _column(file, "committed")]


def steps_of_generations(file: Path) -> list[int]:
    """Return the control steps of each generation; empty if there is no file yet."""
    return [int(steps) for steps in _column(file, "steps")]


def _column(file: Path, name: str) -> list[Any]:
    try:
        with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as connection:
            rows = connection.execute(f"SELECT {name} FROM generations ORDER BY generation")
            return [value for (value,) in rows]
    except sqlite3.OperationalError:
        return []
