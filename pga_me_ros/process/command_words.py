"""Command lines of programs: what comes after an option with several values."""

from __future__ import annotations

from collections.abc import Callable, Sequence


def positionals_first(
    words: Sequence[str], option: str, belongs: Callable[[str], bool]
) -> list[str]:
    """Return a command line in which no positional argument follows the values of an option.

    argparse takes all words up to the next option for values, so ``--descriptor 0.9 0.1 RUN`` would lack RUN.

    Args:
        words: Command line without the program's name.
        option: Option with one value or more.
        belongs: Whether a word may be one of its values.
    """
    first: list[str] = []
    others: list[str] = []
    inside = False
    for word in words:
        if inside and not word.startswith("--") and not belongs(word):
            first.append(word)
            inside = False
            continue
        if word.startswith("--"):
            inside = word == option
        others.append(word)
    return first + others


def is_number(word: str) -> bool:
    """Whether a word is a number, or looks like an option rather than like a name."""
    try:
        float(word)
    except ValueError:
        return word.startswith("-")
    return True
