"""Tasks that are closed at the end of a test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from pga_me_ros.tasks.registry import make_task


@pytest.fixture
def made() -> Iterator[Callable[..., Any]]:
    """Return `make_task`; what it makes is closed at the end."""
    tasks: list[Any] = []

    def make(*arguments: str) -> Any:
        tasks.append(make_task(*arguments))
        return tasks[-1]

    yield make
    for task in tasks:
        task.close()
