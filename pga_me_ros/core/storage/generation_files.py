"""Files of a run that are numbered by generation."""

from __future__ import annotations

import re
from pathlib import Path

from pga_me_ros.core.storage.files import make_folder
from pga_me_ros.errors import StorageError


def generations_of(directory: Path, stem: str) -> list[int]:
    """Return the generations that have a file in a folder, ascending; none if the folder does not exist."""
    pattern = re.compile(re.escape(stem) + r"-(\d{8,})\.ckpt")
    matches = (pattern.fullmatch(path.name) for path in directory.glob(f"{stem}-*.ckpt"))
    return sorted(int(m[1]) for m in matches if m)


class GenerationFiles:
    """The files ``STEM-00000012.ckpt`` of a folder, one per generation.

    Args:
        directory: The folder; made if absent.
        stem: Prefix of the files' names.

    Raises:
        StorageError: The folder cannot be made, or cannot be written to.
    """

    def __init__(self, directory: Path, stem: str) -> None:
        self.directory = directory
        self._stem = stem
        make_folder(directory)

    def path(self, generation: int) -> Path:
        """Return the file of a generation, whether it exists or not."""
        return self.directory / f"{self._stem}-{generation:08d}.ckpt"

    def generations(self) -> list[int]:
        """Return the generations that have a file, ascending."""
        return generations_of(self.directory, self._stem)

    def delete(self, generation: int) -> None:
        """Delete the file of a generation, if it exists.

        Raises:
            StorageError: The file cannot be deleted.
        """
        try:
            self.path(generation).unlink(missing_ok=True)
        except OSError as error:
            raise StorageError(
                f"Cannot delete '{self.path(generation)}' ({error.strerror}); make its folder writable."
            ) from error
