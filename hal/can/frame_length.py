"""The lengths that CAN FD has codes for."""

from __future__ import annotations

FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


def padded_length(count: int) -> int:
    """Return the shortest frame that holds so many bytes; `ValueError` above 64."""
    for length in FD_LENGTHS:
        if length >= count:
            return length
    raise ValueError(f"frame: got {count} bytes, allowed is 0 .. {FD_LENGTHS[-1]}")
