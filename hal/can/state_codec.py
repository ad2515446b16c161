"""One module's state as bytes: echoed sequence, state and error, temperature, its joints' measurements, CRC-16."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from preshape.hal.can.checksum import Bytes, crc16
from preshape.hal.can.frame_length import padded_length
from preshape.hal.can.identifiers import state_id
from preshape.hal.can.topology import Group, Module
from preshape.hal.can.vocabulary import ModuleError, ModuleState
from preshape.hal.state import Vector

TAKEN_BIT = 1 << 2
ERROR_SHIFT = 3
"""The status byte: state in bits 0 and 1, `taken` in bit 2, error above."""

_CRC = struct.Struct("<H")
_ERRORS = frozenset(int(error) for error in ModuleError)
_INT16_MOST = (1 << 15) - 1


def status_byte(state: ModuleState, error: ModuleError, taken: bool = False) -> int:
    """Return state, error and whether the last broadcast was executed, in one byte."""
    return state | taken * TAKEN_BIT | error << ERROR_SHIFT


def status_fields(status: int) -> tuple[ModuleState, ModuleError, bool] | None:
    """Return what a status byte says, None for an unknown error."""
    error = status >> ERROR_SHIFT
    if error not in _ERRORS:
        return None
    return ModuleState(status & 3), ModuleError(error), bool(status & TAKEN_BIT)


@dataclass(frozen=True, slots=True, eq=False)
class ModuleReport:
    """A module's state: `sequence` is that of the broadcast it answers, `taken` whether it executed it.

    position rad, velocity rad/s, torque N m, each (n,); temperature in degrees Celsius.
    """

    sequence: int
    state: ModuleState
    error: ModuleError
    taken: bool
    temperature_degc: int
    position: Vector
    velocity: Vector
    torque: Vector


class StateCodec:
    """Packs and unpacks the states of one module; `length` is that of its payload, bytes.

    Little-endian: sequence u16 | status u8 | temperature i8 | positions | velocities i16 | torques i16 | 0 .. | CRC-16.
    """

    def __init__(self, module: Module, group: Group) -> None:
        """Lay out the frame of a module of a group."""
        count, scale = len(module.joints), group.scale
        self.module = module
        self.frame_id = state_id(module.node)
        width = "h" if scale.position_bits == 16 else "i"
        self._body = struct.Struct(f"<HBb{count}{width}{2 * count}h")
        self.length = padded_length(self._body.size + _CRC.size)
        self._count = count
        scales = [scale.position, scale.velocity, scale.torque]
        self.scale = np.repeat(scales, count)
        """Units of one count of each measurement (3 n,): positions, velocities, torques."""
        most = np.repeat([2.0 ** (scale.position_bits - 1) - 1, _INT16_MOST, _INT16_MOST], count)
        self._units = list(zip(self.scale.tolist(), (-most - 1.0).tolist(), most.tolist(), strict=True))
        """Unit, least and most count of each measurement."""

    def encode(self, report: ModuleReport) -> bytearray:
        """Return a report's payload; what no count can say is written as the nearest that can."""
        # Of a dozen numbers a loop is done sooner than numpy's six passes.
        values = report.position.tolist() + report.velocity.tolist() + report.torque.tolist()
        measured = zip(values, self._units, strict=True)
        counts = [round(min(max(value / unit, least), most)) for value, (unit, least, most) in measured]
        payload = bytearray(self.length)
        status = status_byte(report.state, report.error, report.taken)
        self._body.pack_into(payload, 0, report.sequence, status, report.temperature_degc, *counts)
        end = self.length - _CRC.size
        _CRC.pack_into(payload, end, crc16(self.frame_id, memoryview(payload)[:end]))
        return payload

    def unpack(self, payload: Bytes) -> tuple[int, ...] | None:
        """Return sequence, status byte, temperature and 3 n counts, or None if length or checksum is wrong."""
        if len(payload) != self.length:
            return None
        end = self.length - _CRC.size
        if crc16(self.frame_id, memoryview(payload)[:end]) != _CRC.unpack_from(payload, end)[0]:
            return None
        return self._body.unpack_from(payload)

    def decode(self, payload: Bytes) -> ModuleReport | None:
        """Return what a payload says, or None if its length, checksum or status is not a state's."""
        fields = self.unpack(payload)
        status = None if fields is None else status_fields(fields[1])
        if fields is None or status is None:
            return None
        values = np.array(fields[3:]) * self.scale
        position, velocity, torque = values.reshape(3, self._count)
        return ModuleReport(fields[0], *status, fields[2], position, velocity, torque)


def temperature_of(payload: Bytes) -> int:
    """Return the temperature in a state's payload, degC."""
    return int.from_bytes(payload[3:4], "little", signed=True)
