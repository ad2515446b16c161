"""Slow parameters as bytes: a request to one module, and its answer, both in one 16-byte layout with a CRC-32."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from preshape.hal.can.checksum import Bytes, checksum32
from preshape.hal.can.vocabulary import REAL_PARAMETERS, WHOLE_MODULE, Answer, Operation, Parameter

_REAL = struct.Struct("<BBBBfI")
_WHOLE = struct.Struct("<BBBBII")
_CRC = struct.Struct("<I")
PARAMETER_LENGTH = _WHOLE.size + _CRC.size

_PARAMETERS = frozenset(int(parameter) for parameter in Parameter)
_OPERATIONS = frozenset(int(operation) for operation in Operation)
_ANSWERS = frozenset(int(answer) for answer in Answer)


@dataclass(frozen=True, slots=True)
class Request:
    """Read or write a parameter of a module or of one of its joints (0 .. 3).

    `tag` comes back in the reply; `key` counts only in arming (`Parameter.SESSION`).
    """

    operation: Operation
    parameter: Parameter
    tag: int
    joint: int = WHOLE_MODULE
    value: float = 0
    key: int = 0


@dataclass(frozen=True, slots=True)
class Reply:
    """How a request ended; `value` is the parameter's present value, `key` the module's present arming key."""

    answer: Answer
    parameter: Parameter
    tag: int
    joint: int
    value: float
    key: int


def encode_request(frame_id: int, request: Request) -> bytearray:
    """Return a request's payload: operation | parameter | joint | tag u8 | value u32 or float | key u32 | CRC-32."""
    head = request.operation, request.parameter, request.joint, request.tag
    return _encode(frame_id, request.parameter, head, request.value, request.key)


def encode_reply(frame_id: int, reply: Reply) -> bytearray:
    """Return a reply's payload: answer | parameter | joint | tag u8 | value u32 or float | key u32 | CRC-32."""
    head = reply.answer, reply.parameter, reply.joint, reply.tag
    return _encode(frame_id, reply.parameter, head, reply.value, reply.key)


def decode_request(frame_id: int, payload: Bytes) -> Request | None:
    """Return what a payload says, or None if its length, checksum or words are not a request's."""
    fields = _decode(frame_id, payload, _OPERATIONS)
    if fields is None:
        return None
    operation, parameter, joint, tag, value, key = fields
    return Request(Operation(int(operation)), Parameter(int(parameter)), int(tag), int(joint), value, int(key))


def decode_reply(frame_id: int, payload: Bytes) -> Reply | None:
    """Return what a payload says, or None if its length, checksum or words are not a reply's."""
    fields = _decode(frame_id, payload, _ANSWERS)
    if fields is None:
        return None
    answer, parameter, joint, tag, value, key = fields
    return Reply(Answer(int(answer)), Parameter(int(parameter)), int(tag), int(joint), value, int(key))


def _encode(frame_id: int, parameter: Parameter, head: tuple[int, ...], value: float, key: int) -> bytearray:
    payload = bytearray(PARAMETER_LENGTH)
    if parameter in REAL_PARAMETERS:
        _REAL.pack_into(payload, 0, *head, value, key)
    else:
        _WHOLE.pack_into(payload, 0, *head, int(value), key)
    end = PARAMETER_LENGTH - _CRC.size
    _CRC.pack_into(payload, end, checksum32(frame_id, memoryview(payload)[:end]))
    return payload


def _decode(frame_id: int, payload: Bytes, words: frozenset[int]) -> tuple[float, ...] | None:
    if len(payload) != PARAMETER_LENGTH:
        return None
    end = PARAMETER_LENGTH - _CRC.size
    if checksum32(frame_id, memoryview(payload)[:end]) != _CRC.unpack_from(payload, end)[0]:
        return None
    if payload[0] not in words or payload[1] not in _PARAMETERS:
        return None
    body = _REAL if payload[1] in REAL_PARAMETERS else _WHOLE
    return body.unpack_from(payload)
