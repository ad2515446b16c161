"""A module's heartbeat, ten times a second: that it lives, who it is, and the key that arming it must name."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from preshape.hal.can.checksum import Bytes, crc16
from preshape.hal.can.identifiers import heartbeat_id
from preshape.hal.can.state_codec import status_byte, status_fields
from preshape.hal.can.vocabulary import ModuleError, ModuleState

HEARTBEAT_S = 0.1
"""Time between two heartbeats, s."""

_BODY = struct.Struct("<BBBBHII")
_CRC = struct.Struct("<H")
HEARTBEAT_LENGTH = _BODY.size + _CRC.size


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Who sends it (`serial` number, firmware), how often it has started (`boots`), and its present arming key."""

    state: ModuleState
    error: ModuleError
    count: int
    firmware_major: int
    firmware_minor: int
    boots: int
    serial: int
    key: int


def encode_heartbeat(node: int, beat: Heartbeat) -> bytearray:
    """Return a heartbeat's payload: status | count | firmware u8, u8 | boots u16 | serial u32 | key u32 | CRC-16."""
    payload = bytearray(HEARTBEAT_LENGTH)
    status = status_byte(beat.state, beat.error)
    versions = beat.firmware_major, beat.firmware_minor
    _BODY.pack_into(payload, 0, status, beat.count, *versions, beat.boots, beat.serial, beat.key)
    _CRC.pack_into(payload, _BODY.size, crc16(heartbeat_id(node), memoryview(payload)[: _BODY.size]))
    return payload


def decode_heartbeat(node: int, payload: Bytes) -> Heartbeat | None:
    """Return what a node's payload says, or None if its length, checksum or status is not a heartbeat's."""
    if len(payload) != HEARTBEAT_LENGTH:
        return None
    if crc16(heartbeat_id(node), memoryview(payload)[: _BODY.size]) != _CRC.unpack_from(payload, _BODY.size)[0]:
        return None
    status, *rest = _BODY.unpack_from(payload)
    known = status_fields(status)
    return None if known is None else Heartbeat(known[0], known[1], *rest)
