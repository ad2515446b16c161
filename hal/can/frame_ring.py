"""Frames on their way to another process: what goes through one end of a bus, as records of a ring."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator, Sequence
from typing import Protocol

import can
import numpy as np

from preshape.hal.tick_record import TickRecord

FRAME = np.dtype(
    [
        ("stamp_ns", "<i8"),
        ("identifier", "<u4"),
        ("bus", "u1"),
        ("flags", "u1"),
        ("length", "u1"),
        ("data", "u1", (64,)),
    ]
)
"""One frame: when it came by the interface's own stamp, or was sent (Unix time); which bus; what kind it is (bits)."""

CAPACITY = 1 << 16
"""Frames kept by default: 8 s of both hands and arms at 500 Hz."""

RECEIVED, FD, SWITCHED, EXTENDED, REMOTE, ERROR = (1 << bit for bit in range(6))

_HEAD = struct.Struct("<qIBBB")


class FrameRecords(Protocol):
    """What takes records of frames: a ring's writer."""

    def notify(self, record: TickRecord) -> None:
        """Take one record."""
        ...


class FrameWriter:
    """The one writer of frames; one thread."""

    def __init__(self, records: FrameRecords) -> None:
        """Write into a ring of dtype `FRAME`."""
        self._records = records
        self._bytes = bytearray(FRAME.itemsize)
        self._record = np.frombuffer(self._bytes, FRAME, 1).reshape(())

    def write(self, bus: int, message: can.Message, received: bool) -> None:
        """Hand over one frame of the bus of this number."""
        data = message.data
        stamp_ns = round(message.timestamp * 1e9) if received and message.timestamp else time.time_ns()
        flags = (
            received * RECEIVED
            | message.is_fd * FD
            | message.bitrate_switch * SWITCHED
            | message.is_extended_id * EXTENDED
            | message.is_remote_frame * REMOTE
            | message.is_error_frame * ERROR
        )
        _HEAD.pack_into(self._bytes, 0, stamp_ns, message.arbitration_id, bus, flags, len(data))
        self._bytes[_HEAD.size : _HEAD.size + len(data)] = data
        self._records.notify(self._record)


def frames_of(records: TickRecord, buses: Sequence[str]) -> Iterator[can.Message]:
    """Yield the frames in records (n,); their channels are the names of their buses."""
    for record in records:
        flags = int(record["flags"])
        yield can.Message(
            timestamp=float(record["stamp_ns"]) * 1e-9,
            arbitration_id=int(record["identifier"]),
            channel=buses[int(record["bus"])],
            data=record["data"][: int(record["length"])].tobytes(),
            is_rx=bool(flags & RECEIVED),
            is_fd=bool(flags & FD),
            bitrate_switch=bool(flags & SWITCHED),
            is_extended_id=bool(flags & EXTENDED),
            is_remote_frame=bool(flags & REMOTE),
            is_error_frame=bool(flags & ERROR),
        )
