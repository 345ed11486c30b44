"""Messages that an older version recorded, completed to what they are now."""

from __future__ import annotations

from collections.abc import Mapping

from pga_me_ros.recording.message_heads import PREAMBLE

SEQUENCES_SINCE: Mapping[str, Mapping[str, int]] = {
    "pga_me_msgs/msg/Transitions": {
        # Without intended_descriptor.
        "RIHS01_773d72035328c7022687b5a1ec75718f57e1cb99af78d8afdd765a1d331b2b8c": 1,
    }
}
"""By message type, and by the digest of an older definition of it: sequences that were added at its end since."""


def completed(data: bytes, sequences: int) -> bytes:
    """Return a serialised message with empty sequences at its end.

    Args:
        data: The message, in CDR.
        sequences: How many.
    """
    if not sequences:
        return data
    # A sequence begins with its length, a number of 4 bytes at a multiple of 4.
    return data + bytes(-(len(data) - PREAMBLE) % 4 + 4 * sequences)
