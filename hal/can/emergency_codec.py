"""A module's emergency frame: sent once, at the moment something goes wrong, and above all other traffic but stops."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from preshape.hal.can.checksum import Bytes, crc16
from preshape.hal.can.identifiers import emergency_id
from preshape.hal.can.state_codec import status_byte, status_fields
from preshape.hal.can.vocabulary import ModuleError, ModuleState

_BODY = struct.Struct("<BBBBH")
_CRC = struct.Struct("<H")
EMERGENCY_LENGTH = _BODY.size + _CRC.size


@dataclass(frozen=True, slots=True)
class Emergency:
    """What went wrong in which node, at which of its joints (`WHOLE_MODULE`: all), and in which state it is now."""

    state: ModuleState
    error: ModuleError
    node: int
    joint: int
    count: int
    detail: int = 0


def encode_emergency(emergency: Emergency) -> bytearray:
    """Return an emergency's payload: status | node | joint | count u8 | detail u16 | CRC-16."""
    payload = bytearray(EMERGENCY_LENGTH)
    status = status_byte(emergency.state, emergency.error)
    _BODY.pack_into(payload, 0, status, emergency.node, emergency.joint, emergency.count, emergency.detail)
    checksum = crc16(emergency_id(emergency.node), memoryview(payload)[: _BODY.size])
    _CRC.pack_into(payload, _BODY.size, checksum)
    return payload


def decode_emergency(node: int, payload: Bytes) -> Emergency | None:
    """Return what a node's payload says, or None if its length, checksum, node or status is not an emergency's."""
    if len(payload) != EMERGENCY_LENGTH:
        return None
    if crc16(emergency_id(node), memoryview(payload)[: _BODY.size]) != _CRC.unpack_from(payload, _BODY.size)[0]:
        return None
    status, sender, joint, count, detail = _BODY.unpack_from(payload)
    known = status_fields(status)
    return None if known is None or sender != node else Emergency(known[0], known[1], node, joint, count, detail)
