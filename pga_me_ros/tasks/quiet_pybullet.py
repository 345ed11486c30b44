"""PyBullet without the line that its C library prints whenever it is loaded, wherever it is imported."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

MODULE = "pybullet"
BANNER = b"pybullet build time:"
STANDARD_ERROR = 2


def silence_banner() -> None:
    """Leave PyBullet's banner out of standard error when it is imported later, also by a user's task."""
    if MODULE not in sys.modules and not any(isinstance(f, _Finder) for f in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds PyBullet as Python does, and wraps its loader."""

    def __init__(self) -> None:
        self._searching = False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return PyBullet's spec; None for other modules, which the other finders find."""
        if fullname != MODULE or self._searching:
            return None
        self._searching = True
        try:
            spec = find_spec(fullname)
        finally:
            self._searching = False
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader)
        return spec


class _Loader(Loader):
    """Loads a module with another loader, and leaves out the banner.

    Args:
        loader: The other loader.
    """

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Create the module, which loads the library."""
        with _without_banner():
            return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Initialize the module, which prints the banner."""
        with _without_banner():
            self._loader.exec_module(module)


@contextmanager
def _without_banner() -> Iterator[None]:
    """Hold back what is written to standard error during a block, and write it afterwards without the banner."""
    held = os.memfd_create("stderr")
    try:
        kept = os.dup(STANDARD_ERROR)
    except OSError:  # closed: nothing will be seen
        os.close(held)
        yield
        return
    os.dup2(held, STANDARD_ERROR)
    try:
        yield
    finally:
        os.dup2(kept, STANDARD_ERROR)
        os.close(kept)
        os.lseek(held, 0, os.SEEK_SET)
        with open(held, "rb") as content:
            lines = [line for line in content if not line.startswith(BANNER)]
        if lines:
            os.write(STANDARD_ERROR, b"".join(lines))
