"""The quick stop: four bytes that say who stops and why. Modules obey its identifier, whatever it holds."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from preshape.hal.can.checksum import Bytes

HOST = 0
"""Source of a quick stop that the controller sends; a module sends its node number."""

_BODY = struct.Struct("<BBH")
QUICK_STOP_LENGTH = _BODY.size


class StopReason(IntEnum):
    """Why the sender stops everybody."""

    ORDER = 0
    NODE_LOST = 1
    MODULE_FAULT = 2
    BUS_FAULT = 3
    CLOSING = 4


@dataclass(frozen=True, slots=True)
class QuickStop:
    """Why, who, and a number that tells the sender's quick stops apart."""

    reason: StopReason
    source: int
    count: int


def encode_quick_stop(stop: QuickStop) -> bytearray:
    """Return a quick stop's payload: reason u8 | source u8 | count u16."""
    return bytearray(_BODY.pack(stop.reason, stop.source, stop.count))


def decode_quick_stop(payload: Bytes) -> QuickStop | None:
    """Return what a payload says, or None if it says nothing that is known; it is a quick stop all the same."""
    if len(payload) != QUICK_STOP_LENGTH:
        return None
    reason, source, count = _BODY.unpack_from(payload)
    return QuickStop(StopReason(reason), source, count) if reason in _REASONS else None


_REASONS = frozenset(int(reason) for reason in StopReason)
