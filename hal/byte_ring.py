"""Messages of any length on their way to another process: cut into pieces that a ring carries."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from preshape.hal.tick_record import TickRecord
from preshape.hal.tick_ring import RingReader

PIECE_BYTES = 8180
PIECE = np.dtype(
    [("number", np.int32), ("count", np.int32), ("size", np.int32), ("data", np.uint8, (PIECE_BYTES,))], align=True
)
"""One piece: which it is, 0, 1, ..., of how many of the same message, how many of its bytes count, and the bytes."""

CAPACITY = 1024
"""Pieces kept by default: 8 MB."""


class PieceWriter(Protocol):
    """What takes pieces: a ring's writer, waiting or not."""

    def notify(self, record: TickRecord) -> None:
        """Take one piece."""
        ...


class ByteWriter:
    """The one writer of messages; one thread."""

    def __init__(self, writer: PieceWriter) -> None:
        """Write into a ring of dtype `PIECE`."""
        self._writer = writer
        self._piece = np.zeros((), PIECE)

    def send(self, message: bytes) -> None:
        """Hand over one message."""
        count = max(1, -(-len(message) // PIECE_BYTES))
        for number in range(count):
            data = message[number * PIECE_BYTES : (number + 1) * PIECE_BYTES]
            self._piece["number"], self._piece["count"], self._piece["size"] = number, count, len(data)
            self._piece["data"][: len(data)] = np.frombuffer(data, np.uint8)
            self._writer.notify(self._piece)


class ByteReader:
    """Puts messages together again; one of which a piece is lost is left out whole, and `lost` counts it."""

    def __init__(self, reader: RingReader) -> None:
        """Read from a ring of dtype `PIECE`."""
        self._reader = reader
        self._parts: list[bytes] = []
        self._dropped = 0
        self.lost = 0

    def read(self) -> list[bytes]:
        """Return all messages that are complete by now, in order."""
        messages: list[bytes] = []
        while len(pieces := self._reader.read()):
            if self._reader.dropped != self._dropped:
                self._dropped = self._reader.dropped
                self.lost += 1
                self._parts = []
            for piece in pieces:
                self._take(piece, messages)
        return messages

    def _take(self, piece: TickRecord, messages: list[bytes]) -> None:
        number = int(piece["number"])
        if number != len(self._parts):
            # Its beginning is lost.
            self._parts = []
            return
        self._parts.append(piece["data"][: int(piece["size"])].tobytes())
        if number + 1 == int(piece["count"]):
            messages.append(b"".join(self._parts))
            self._parts = []
