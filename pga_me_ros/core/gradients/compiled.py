"""Compiled arithmetic, which threads do in parallel without waiting for each other's Python code."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TypeVar

import torch

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return a function of tensors compiled by TorchScript.

    Only one thread at a time runs Python, and everything between two torch calls is Python. A compiled function takes
    its turn once, however many torch calls it makes. These are the calls of its Python code, in the same order, so the
    bits are the same without compiling (with torch's own switch, ``PYTORCH_JIT=0``).

    Args:
        function: In the subset of Python that TorchScript supports. Its annotations must be types, not strings, so its
            file must not have ``from __future__ import annotations``.
    """
    with warnings.catch_warnings():
        # torch recommends torch.compile, which needs a C++ compiler on the robot's machine and merges calls.
        warnings.simplefilter("ignore", DeprecationWarning)
        script: Function = torch.jit.script(function)
    return script
