"""Errors that a user can act on: each message says what was wrong, what was expected, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class PgaError(ValueError):
    """Base class of all errors due to bad input; messages are meant to be shown as they are."""


class SettingsError(PgaError):
    """A setting has an unknown name, the wrong type, or a value out of its range."""


class TaskError(PgaError):
    """A task is unknown, cannot be loaded, or breaks the task protocol."""


class NetworkError(PgaError):
    """A controller's or critic's parameters do not fit its layers, or are not finite."""


class ArchiveError(PgaError):
    """A solution, descriptor or cell does not fit the archive."""


class StorageError(PgaError):
    """A run directory or repertoire file is unreadable, unwritable, damaged or of another run."""


class RequestError(PgaError):
    """A request to a node is malformed or does not belong to its run."""


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the known name nearest to a misspelled one, else ``""``."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""
