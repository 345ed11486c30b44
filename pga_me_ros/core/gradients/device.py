"""Where torch computes: threads of a matrix product, and the device."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from pga_me_ros.errors import SettingsError


@contextmanager
def torch_threads(threads: int) -> Iterator[None]:
    """Compute with this number of threads within the block; the last bits of a sum depend on it."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def choose_device(device: str) -> torch.device:
    """Return the torch device of a name.

    Args:
        device: 'auto' uses a GPU if torch finds one, else the CPU; any other name is torch's own,
            such as 'cpu'.

    Raises:
        SettingsError: torch does not know the device or cannot use it here.
    """
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise SettingsError(
            f"Device '{device}' cannot be used here ({reason}); give 'auto' or 'cpu'."
        ) from error
    return torch.device(device)
