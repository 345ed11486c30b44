"""Arithmetic that threads do side by side without waiting for each other's Python."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TypeVar

import torch

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return a function of tensors compiled by TorchScript.

    Only one thread at a time runs Python, and what lies between two torch calls is Python. A compiled function takes
    its turn once, whatever number of torch calls it makes. They are the calls that its Python code makes, in the same
    order, so the bits are the same without compiling (with torch's own switch, ``PYTORCH_JIT=0``).

    Args:
        function: In the part of Python that TorchScript knows. Its annotations must be types, not strings, so its file
            does without ``from __future__ import annotations``.
    """
    with warnings.catch_warnings():
        # torch advises torch.compile, which needs a C++ compiler on the robot's machine and merges calls.
        warnings.simplefilter("ignore", DeprecationWarning)
        script: Function = torch.jit.script(function)
    return script
