"""States and commands as bytes between the controller's process and the one that serves its device: pure functions.

Both run on one machine: times are on its monotonic clock, which all its processes share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState

MAGIC = 0x70725301
"""First word of every message; its last byte is the version."""

FAULT_LENGTH = 80

STATE = np.dtype(
    [
        ("magic", "<u4"),
        ("status", "<i4"),
        ("seq", "<i8"),
        ("epoch", "<i8"),
        ("sent_ns", "<i8"),
        ("sequence", "<i8"),
        ("fault", f"S{FAULT_LENGTH}"),
        ("position", "<f8", (LAYOUT.dof,)),
        ("velocity", "<f8", (LAYOUT.dof,)),
        ("torque", "<f8", (LAYOUT.dof,)),
        ("stamp_ns", "<i8", (LAYOUT.dof,)),
    ]
)
"""One state. `seq` counts messages: a gap is a loss; `epoch` counts how often the device was armed, stopped or closed:
commands of another one are not taken; `sent_ns` is when it was sent; the rest is `RobotState`."""

COMMAND = np.dtype(
    [
        ("magic", "<u4"),
        ("mode", "<i4"),
        ("client", "<i8"),
        ("epoch", "<i8"),
        ("sequence", "<i8"),
        ("sent_ns", "<i8"),
        ("position", "<f8", (LAYOUT.dof,)),
        ("torque_limit", "<f8", (LAYOUT.dof,)),
        ("torque", "<f8", (LAYOUT.dof,)),
    ]
)
"""One command of the client that has opened the device."""

Record = NDArray[np.void]

_MODES = frozenset(int(mode) for mode in Mode)
_STATUSES = frozenset(int(status) for status in DeviceStatus)


def encode_state(state: RobotState, seq: int, epoch: int, now_ns: int) -> bytes:
    """Return a state's bytes."""
    out = np.zeros((), STATE)
    out["magic"], out["status"] = MAGIC, int(state.status)
    out["seq"], out["epoch"], out["sent_ns"], out["sequence"] = seq, epoch, now_ns, state.sequence
    out["fault"] = state.fault.encode("ascii", "replace")
    out["position"], out["velocity"], out["torque"] = state.position, state.velocity, state.torque
    out["stamp_ns"] = state.stamp_ns
    return out.tobytes()


def decode_state(payload: bytes) -> Record | None:
    """Return the record in a state's bytes, None if they are not one."""
    record = _decode(payload, STATE)
    return record if record is not None and int(record["status"]) in _STATUSES else None


def state_of(record: Record) -> RobotState:
    """Return the device's state in a decoded record."""
    return RobotState(
        int(record["sequence"]),
        record["position"],
        record["velocity"],
        record["torque"],
        record["stamp_ns"],
        DeviceStatus(int(record["status"])),
        bytes(record["fault"].item()).decode("ascii", "replace"),
    )


def encode_command(command: RobotCommand, client: int, epoch: int, now_ns: int) -> bytes:
    """Return a command's bytes."""
    out = np.zeros((), COMMAND)
    out["magic"], out["mode"], out["client"], out["epoch"] = MAGIC, int(command.mode), client, epoch
    out["sequence"], out["sent_ns"] = command.sequence, now_ns
    out["position"], out["torque_limit"], out["torque"] = command.position, command.torque_limit, command.torque
    return out.tobytes()


def decode_command(payload: bytes) -> Record | None:
    """Return the record in a command's bytes, None if they are not one or hold what is not finite."""
    record = _decode(payload, COMMAND)
    if record is None or int(record["mode"]) not in _MODES:
        return None
    values = (record["position"], record["torque_limit"], record["torque"])
    return record if all(bool(np.isfinite(value).all()) for value in values) else None


def command_of(record: Record) -> RobotCommand:
    """Return the command in a decoded record."""
    return RobotCommand(
        int(record["sequence"]),
        Mode(int(record["mode"])),
        record["position"],
        record["torque_limit"],
        record["torque"],
    )


def _decode(payload: bytes, dtype: np.dtype[np.void]) -> Record | None:
    if len(payload) != dtype.itemsize:
        return None
    record: Record = np.frombuffer(payload, dtype, 1).reshape(())
    return record if int(record["magic"]) == MAGIC else None
