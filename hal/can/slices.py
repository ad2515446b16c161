"""Payloads in classic CAN frames: three 16-bit words a frame, after a byte that counts slices and one that tags them.

A payload of up to 8 bytes is a frame as it is. A longer one is cut into frames of 8 bytes: slice number u8 |
tag u8 | 6 bytes of the payload, the last one filled up with zeros. Slices of one identifier come in
order, for a bus keeps it; the tag changes with every payload, so that a lost slice loses its payload and no other.
Whether a payload is whole is told by its own checksum.
"""

from __future__ import annotations

from preshape.hal.can.checksum import Bytes

SLICE_BYTES = 6
CLASSIC_BYTES = 8
TAGS = 256


def slice_count(length: int) -> int:
    """Return how many classic frames carry a payload of so many bytes."""
    return 1 if length <= CLASSIC_BYTES else -(-length // SLICE_BYTES)


def cut(payload: Bytes, tag: int) -> list[bytes]:
    """Return the contents of the classic frames that carry a payload."""
    if len(payload) <= CLASSIC_BYTES:
        return [bytes(payload)]
    return [
        bytes((number, tag)) + bytes(payload[at : at + SLICE_BYTES]).ljust(SLICE_BYTES, b"\0")
        for number, at in enumerate(range(0, len(payload), SLICE_BYTES))
    ]


class Joiner:
    """Puts the slices of one identifier together again: payloads of one known length."""

    def __init__(self, length: int) -> None:
        """Expect payloads of a length in bytes."""
        self._length = length
        self._count = slice_count(length)
        self._parts: list[bytes] = []
        self._tag = -1

    def add(self, content: Bytes) -> bytes | None:
        """Take one frame's content; return the payload if it was the last slice of a whole one."""
        if self._count == 1:
            return bytes(content)
        if len(content) != CLASSIC_BYTES:
            return None
        number, tag = content[0], content[1]
        if number == 0:
            self._parts, self._tag = [], tag
        elif tag != self._tag or number != len(self._parts):
            self._parts, self._tag = [], -1
            return None
        self._parts.append(bytes(content[2:]))
        if len(self._parts) < self._count:
            return None
        payload = b"".join(self._parts)[: self._length]
        self._parts, self._tag = [], -1
        return payload
