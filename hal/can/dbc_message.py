"""What each frame of a topology holds, signal by signal: the tables that the DBC file is written from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from preshape.hal.can.command_codec import MODE_SHIFT, CommandCodec
from preshape.hal.can.emergency_codec import EMERGENCY_LENGTH
from preshape.hal.can.heartbeat_codec import HEARTBEAT_LENGTH
from preshape.hal.can.identifiers import QUICK_STOP_ID, emergency_id, heartbeat_id, reply_id, request_id
from preshape.hal.can.parameter_codec import PARAMETER_LENGTH
from preshape.hal.can.quick_stop_codec import QUICK_STOP_LENGTH, StopReason
from preshape.hal.can.state_codec import StateCodec
from preshape.hal.can.topology import Group, Module, Topology
from preshape.hal.can.vocabulary import (
    PARAMETER_UNITS,
    REAL_PARAMETERS,
    Answer,
    ModuleError,
    ModuleState,
    Operation,
    Parameter,
    WireMode,
)

HOST_NAME = "host"


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """One value in a frame, little-endian from bit `start` on: physical value = scale x integer.

    `real`: a 32-bit float instead of an integer; `choices`: words for its numbers; `selects`: its number says
    which of the signals with a `selected_by` number are there.
    """

    name: str
    start: int
    bits: int
    signed: bool = False
    scale: float = 1.0
    unit: str = ""
    real: bool = False
    choices: Mapping[int, str] = field(default_factory=dict[int, str])
    selects: bool = False
    selected_by: int | None = None


@dataclass(frozen=True, slots=True)
class Message:
    """One frame: its identifier, name, sender, length in bytes, and what it holds."""

    frame_id: int
    name: str
    sender: str
    length: int
    signals: tuple[Signal, ...]


def messages(topology: Topology) -> tuple[Message, ...]:
    """Return every frame that may be seen on the buses of a topology, by identifier."""
    found = [_quick_stop()]
    for group in topology.groups:
        found.append(_command(group))
        for module in group.modules:
            found += [_emergency(module), _state(module, group), _heartbeat(module), *_parameters(module)]
    return tuple(sorted(found, key=lambda message: message.frame_id))


def words(enum: type[IntEnum]) -> dict[int, str]:
    """Return the names of an enumeration's numbers in lower case."""
    return {int(member): member.name.lower() for member in enum}


class _Row:
    """Signals put one after another."""

    def __init__(self) -> None:
        self.signals: list[Signal] = []
        self._at = 0

    def add(self, name: str, bits: int, **more: object) -> None:
        self.signals.append(Signal(name=name, start=self._at, bits=bits, **more))  # type: ignore[arg-type]
        self._at += bits

    def checksum(self, length: int, bits: int) -> tuple[Signal, ...]:
        """End with a checksum in the frame's last bits."""
        self._at = 8 * length - bits
        self.add("checksum", bits)
        return tuple(self.signals)


def _status(row: _Row) -> None:
    row.add("state", 2, choices=words(ModuleState))
    row.add("taken", 1)
    row.add("error", 5, choices=words(ModuleError))


def _each(row: _Row, joints: Iterable[str], what: str, bits: int, signed: bool, scale: float, unit: str) -> None:
    for joint in joints:
        row.add(f"{joint}_{what}", bits, signed=signed, scale=scale, unit=unit)


def _quick_stop() -> Message:
    row = _Row()
    row.add("reason", 8, choices=words(StopReason))
    row.add("source", 8)
    row.add("count", 16)
    return Message(QUICK_STOP_ID, "quick_stop", HOST_NAME, QUICK_STOP_LENGTH, tuple(row.signals))


def _command(group: Group) -> Message:
    codec, row, scale = CommandCodec(group), _Row(), group.scale
    row.add("session", 32)
    row.add("sequence", 16)
    row.add("enable", MODE_SHIFT)
    row.add("mode", 3, choices=words(WireMode))
    _each(row, group.joints, "target", scale.position_bits, True, scale.position, "rad")
    _each(row, group.joints, "limit", 16, False, scale.torque, "N m")
    return Message(codec.frame_id, f"{group.name}_command", HOST_NAME, codec.length, row.checksum(codec.length, 32))


def _state(module: Module, group: Group) -> Message:
    codec, row, scale = StateCodec(module, group), _Row(), group.scale
    row.add("sequence", 16)
    _status(row)
    row.add("temperature", 8, signed=True, unit="degC")
    _each(row, module.joints, "position", scale.position_bits, True, scale.position, "rad")
    _each(row, module.joints, "velocity", 16, True, scale.velocity, "rad/s")
    _each(row, module.joints, "torque", 16, True, scale.torque, "N m")
    return Message(codec.frame_id, f"{module.name}_state", module.name, codec.length, row.checksum(codec.length, 16))


def _heartbeat(module: Module) -> Message:
    row = _Row()
    _status(row)
    for name, bits in (("count", 8), ("firmware_major", 8), ("firmware_minor", 8), ("boots", 16)):
        row.add(name, bits)
    row.add("serial", 32)
    row.add("key", 32)
    signals = row.checksum(HEARTBEAT_LENGTH, 16)
    return Message(heartbeat_id(module.node), f"{module.name}_heartbeat", module.name, HEARTBEAT_LENGTH, signals)


def _emergency(module: Module) -> Message:
    row = _Row()
    _status(row)
    for name, bits in (("node", 8), ("joint", 8), ("count", 8), ("detail", 16)):
        row.add(name, bits)
    signals = row.checksum(EMERGENCY_LENGTH, 16)
    return Message(emergency_id(module.node), f"{module.name}_emergency", module.name, EMERGENCY_LENGTH, signals)


def _parameters(module: Module) -> tuple[Message, Message]:
    request = _parameter_signals("operation", words(Operation))
    reply = _parameter_signals("answer", words(Answer))
    return (
        Message(request_id(module.node), f"{module.name}_request", HOST_NAME, PARAMETER_LENGTH, request),
        Message(reply_id(module.node), f"{module.name}_reply", module.name, PARAMETER_LENGTH, reply),
    )


def _parameter_signals(first: str, choices: Mapping[int, str]) -> tuple[Signal, ...]:
    """Return the signals of both directions; the value is named by the parameter that it belongs to."""
    values = [
        Signal(
            name=parameter.name.lower(),
            start=32,
            bits=32,
            unit=PARAMETER_UNITS.get(parameter, ""),
            real=parameter in REAL_PARAMETERS,
            signed=parameter in REAL_PARAMETERS,
            selected_by=int(parameter),
        )
        for parameter in Parameter
    ]
    return (
        Signal(name=first, start=0, bits=8, choices=choices),
        Signal(name="parameter", start=8, bits=8, choices=words(Parameter), selects=True),
        Signal(name="joint", start=16, bits=8),
        Signal(name="tag", start=24, bits=8),
        *values,
        Signal(name="arming_key", start=64, bits=32),
        Signal(name="checksum", start=96, bits=32),
    )
