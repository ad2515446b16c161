"""One group's command broadcast as bytes: session, sequence, mode, enabled joints, targets, torque limits, CRC-32."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from preshape.hal.can.checksum import Bytes, checksum32
from preshape.hal.can.command_counts import CommandCounts
from preshape.hal.can.frame_length import padded_length
from preshape.hal.can.identifiers import command_id
from preshape.hal.can.topology import Group
from preshape.hal.can.vocabulary import WireMode
from preshape.hal.state import Vector

MODE_SHIFT = 13
"""The mode stands above the bits of up to 13 enabled joints."""
SEQUENCES = 1 << 16
"""Sequence numbers wrap here."""

_CRC = struct.Struct("<I")
_MODES = frozenset(int(mode) for mode in WireMode)


@dataclass(frozen=True, slots=True, eq=False)
class GroupCommand:
    """A broadcast as a module sees it: targets in rad (in torque mode N m) and torque limits in N m, both (n,).

    Bit k of `enable` belongs to the group's joint k; a joint that is not enabled ignores mode and target.
    """

    session: int
    sequence: int
    mode: WireMode
    enable: int
    target: Vector
    torque_limit: Vector


class CommandCodec:
    """Packs and unpacks the command broadcasts of one group; `length` is that of its payload, bytes.

    Little-endian: session u32 | sequence u16 | enable u13, mode u3 | targets | torque limits u16 | 0 .. | CRC-32.
    A target is rounded to the nearest count, a torque limit down (see `CommandCounts`).
    """

    def __init__(self, group: Group) -> None:
        """Lay out the frame of a group; `ValueError` if it takes more than 64 bytes or 13 joints."""
        count, scale = len(group.joints), group.scale
        if count > MODE_SHIFT:
            raise ValueError(f"joints of group {group.name}: got {count}, allowed is 1 .. {MODE_SHIFT}")
        self.group = group
        self.frame_id = command_id(group.number)
        self._body = struct.Struct(f"<IHH{count}{'h' if scale.position_bits == 16 else 'i'}{count}H")
        self.length = padded_length(self._body.size + _CRC.size)
        self.everything = (1 << count) - 1
        self._count = count
        self._counts = CommandCounts([(range(count), scale)], count)

    def new_payload(self) -> bytearray:
        """Return a zeroed payload to encode into."""
        return bytearray(self.length)

    def encode(
        self,
        payload: bytearray,
        session: int,
        sequence: int,
        mode: WireMode,
        enable: int,
        target: Vector,
        torque_limit: Vector,
    ) -> None:
        """Write a command into a payload of `length` bytes.

        Targets (rad, or N m in torque mode) and limits (N m) are (n,) in the group's order and finite.
        """
        self.pack(payload, session, sequence, mode, enable, self._counts.of(target, torque_limit))

    def pack(
        self, payload: bytearray, session: int, sequence: int, mode: WireMode, enable: int, counts: Sequence[int]
    ) -> None:
        """Write a command whose targets and limits are counts already, as `CommandCounts` gives them."""
        self._body.pack_into(payload, 0, session, sequence, enable | mode << MODE_SHIFT, *counts)
        end = self.length - _CRC.size
        _CRC.pack_into(payload, end, checksum32(self.frame_id, memoryview(payload)[:end]))

    def decode(self, payload: Bytes) -> GroupCommand | None:
        """Return what a payload says, or None if its length, checksum or mode is not a command's."""
        if len(payload) != self.length:
            return None
        end = self.length - _CRC.size
        if checksum32(self.frame_id, memoryview(payload)[:end]) != _CRC.unpack_from(payload, end)[0]:
            return None
        session, sequence, word, *integers = self._body.unpack_from(payload)
        mode = word >> MODE_SHIFT
        if mode not in _MODES:
            return None
        values = np.array(integers) * self._counts.scale
        enable = word & self.everything
        return GroupCommand(session, sequence, WireMode(mode), enable, values[: self._count], values[self._count :])
