"""When a run under way committed its generations; shared by the benches of the graph, no bench itself."""

from __future__ import annotations

import sqlite3
from datetime import datetime
from pathlib import Path


def committed(file: Path) -> list[float]:
    """Return when each generation was committed, seconds; empty while there is no file yet."""
    try:
        with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as connection:
            rows = connection.execute("SELECT committed FROM generations ORDER BY generation")
            return [datetime.fromisoformat(text).timestamp() for (text,) in rows]
    except sqlite3.OperationalError:
        return []
